"""Thin rigid bodies by the method mls: which bodies have sides, and that material stays on its own."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from solver.config import SolverConfig
from solver.mls.drop import ExplicitDrop
from solver.mls.plates import thin_bodies
from solver.model.bodies import Model
from solver.runtime import start


def stepping(*bodies, gravity=(0.0, 0.0, -9.81), **config):
    """A drop to be stepped by hand."""
    start(2)
    return ExplicitDrop(Model(tuple(bodies), np.asarray(gravity, dtype=float)), SolverConfig(method="mls", **config))


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize("cpic", [True, False])
def test_a_thin_plate_keeps_two_soft_blocks_apart_with_cpic_only(lab, cpic):
    """A block glides without friction over a plate of a quarter cell; one under the plate must not feel it."""
    h = 0.0125
    plate = lab.rigid("plate", lab.Box(np.array([0.3, 0.2, 0.003])), [0, 0, 0], fixed=True, mu=(0.0, 0.0), spacing=5e-4)
    side = np.array([0.05, 0.05, 0.025])
    over = lab.soft("over", lab.Box(side), [0, 0, 0.0155], E=5e4, cell=h)
    under = lab.soft("under", lab.Box(side), [0, 0, -0.0155], E=5e4, cell=h)
    one = stepping(over, under, plate, gravity=(0, 0, 0), mls_cell=h, cpic=cpic)
    p = one.soft.particles
    p.v[p.group == 0, 0] = 0.1
    one.soft.lay_out()
    for _ in range(100):
        one.step(1e-4)
    dragged = one.soft.motion(1).velocity[0]
    if cpic:
        assert abs(dragged) < 1e-6
        assert one.soft.motion(0).velocity[0] == pytest.approx(0.1, rel=1e-6)
    else:
        assert dragged > 0.01  # through the shared nodes


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize("height", [0.0, 0.004])
def test_a_thin_plate_with_cpic_lets_no_material_through(lab, height):
    """A block dropped on a plate of a quarter cell stays above it to the last particle and rests, wherever the plate
    lies between the nodes."""
    h = 0.0125
    plate = lab.rigid("plate", lab.Box(np.array([0.2, 0.2, 0.003])), [0, 0, height], fixed=True, spacing=5e-4)
    block = lab.soft("block", lab.Box(np.array([0.1, 0.1, 0.05])), [0, 0, 0.032 + height], E=5e4, cell=h)
    one = stepping(block, plate, mls_cell=h, cpic=True, step_limit=40)
    result = one.run(None)
    assert result.verdict == "at_rest"
    # particles start h / 4 inside of the surface and contact is known to a fifth of a cell
    assert one.soft.particles.x[:, 2].min() > height
    assert abs(result.bodies[0].vertices[:, 2].min() - height - 0.0015) < 0.2 * h


def table(lab, thickness):
    """A board on a thick leg, fixed, as one body."""
    board, leg = lab.Box(np.array([0.3, 0.3, thickness])), lab.Box(np.array([0.1, 0.1, 0.1]))
    below = np.array([0.0, 0.0, 0.05 + 0.4 * thickness])
    body = lab.rigid("table", lab.Box(np.array([0.3, 0.3, 0.2])), [0, 0, 0], fixed=True, spacing=2e-3)
    grid = body.distance
    axes = [o + grid.spacing * np.arange(n) for o, n in zip(grid.origin, grid.values.shape, strict=True)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    values = np.minimum(board.distance(points), leg.distance(points + below)).astype(np.float32)
    surface = board.surface(0.02)
    return replace(body, vertices=surface.vertices, faces=surface.faces, distance=replace(grid, values=values))


@pytest.mark.parametrize(("thickness", "thin"), [(0.006, True), (0.02, True), (0.03, False)])
def test_a_body_has_sides_where_a_part_of_it_is_thinner_than_two_cells(lab, thickness, thin):
    """The board of a table decides, not its leg; what is thicker has none, nor has a thin body that can never meet
    material."""
    h = 0.0125
    board = table(lab, thickness)
    block = lab.soft("block", lab.Box(np.full(3, 0.05)), [0, 0, 0.06], E=5e4, cell=h)
    assert thin_bodies(Model((board, block), np.array([0.0, 0.0, -9.81])), h) == ([0] if thin else [])
    pad = lab.soft("pad", lab.Box(np.full(3, 0.05)), [0, 0, 0.5], E=5e4, cell=h, fixed=True, held=np.s_[:, :, 0])
    assert thin_bodies(Model((board, pad), np.array([0.0, 0.0, -9.81])), h) == []


@pytest.mark.parametrize(("gap", "overlap"), [(3.0, True), (5.0, False)])
@pytest.mark.parametrize("order", [1, -1])
def test_a_result_says_where_material_is_near_two_thin_bodies(lab, gap, overlap, order):
    """Sides reach two cells: material between boards of a quarter cell that are three cells apart is near both, of
    which one only keeps its sides, whichever comes first; between boards five cells apart none is."""
    h, size = 0.0125, np.array([0.15, 0.15, 0.003])
    boards = [
        lab.rigid(name, lab.Box(size), [0, 0, z], fixed=True, spacing=7e-4)
        for name, z in (("low", 0.0), ("high", gap * h + 0.003))
    ]
    block = lab.soft("block", lab.Box(np.array([0.05, 0.05, 0.02])), [0, 0, 0.0015 + 0.5 * gap * h], E=5e4, cell=h)
    result = stepping(*boards[::order], block, mls_cell=h, step_limit=1).run(None)
    said = [line for line in result.warnings if "'low'" in line and "'high'" in line and "may leak" in line]
    assert len(said) == int(overlap)


@pytest.mark.parametrize("tilt", [0.0, 0.4])
@pytest.mark.parametrize("edge", [1.0, 0.01])
def test_a_plate_has_sides_however_few_its_triangles_are(lab, edge, tilt):
    """A plate of a sixth of a cell has them as 12 triangles, whose points are its corners, and subdivided."""
    h = 0.0125
    turn = Rotation.from_rotvec([tilt, 0.5 * tilt, 0.0]).as_matrix()
    plate = lab.rigid("plate", lab.Box(np.array([0.1, 0.1, 0.002])), [0, 0, 0.2], edge=edge, spacing=7e-4,
                      rotation=turn)  # fmt: skip
    assert (len(plate.faces) == 12) == (edge == 1.0)
    block = lab.soft("block", lab.Box(np.full(3, 0.05)), [0, 0, 0.06], E=5e4, cell=h)
    assert thin_bodies(Model((plate, block), np.array([0.0, 0.0, -9.81])), h) == [0]


@pytest.mark.parametrize("solid", ["ball", "block", "rod"])
def test_round_and_thick_bodies_have_no_sides(lab, solid):
    """A ball of three cells, a block and a rod of two and a half: normals turn, or the other side is too far."""
    h = 0.0125
    shape = {"ball": lab.Capsule(1.5 * h, 0.0), "block": lab.Box(np.full(3, 2.5 * h)), "rod": lab.Capsule(1.25 * h, h)}
    body = lab.rigid(f"rigid {solid}", shape[solid], [0, 0, 0.2], edge=0.004, spacing=1e-3)
    block = lab.soft("block", lab.Box(np.full(3, 0.05)), [0, 0, 0.06], E=5e4, cell=h)
    assert thin_bodies(Model((body, block), np.array([0.0, 0.0, -9.81])), h) == []
