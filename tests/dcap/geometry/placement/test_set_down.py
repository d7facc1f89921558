"""Objects set down on random supports: one centimetre over what lies beneath, and in nothing."""

from dataclasses import dataclass

import numpy as np
import pytest
import trimesh
from hypothesis import assume, example, given, settings
from hypothesis import strategies as st

from dcap.geometry.distance import MeshDistance
from dcap.geometry.placement.clearance import Clearance, Start, set_down
from dcap.geometry.placement.named_regions import Region
from dcap.geometry.placement.poses import about_z
from dcap.geometry.placement.search import PlacementSearch
from dcap.geometry.raycast import Raycaster
from dcap.scene.types.mesh import Mesh

GAP = 0.01
WIDE, DEEP = 1.2, 0.9
KINDS = ("ball", "block", "bar", "bottle", "stool", "mug")
SQUARE = np.array([[-WIDE, -DEEP], [WIDE, -DEEP], [WIDE, DEEP], [-WIDE, DEEP]]) / 2.0


def as_mesh(shape: trimesh.Trimesh, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Mesh:
    return Mesh.of(shape.vertices + np.array([x, y, z]), shape.faces)


def block(low: tuple[float, float, float], high: tuple[float, float, float]) -> Mesh:
    return as_mesh(trimesh.creation.box(bounds=[low, high]))


def rod(radius: float, low: float, high: float, x: float, y: float) -> Mesh:
    shape = trimesh.creation.cylinder(radius=radius, height=high - low, sections=12)
    return as_mesh(shape, x, y, (low + high) / 2)


def ball(radius: float, x: float = 0.0, y: float = 0.0, z: float = 0.0, flat: float = 1.0) -> Mesh:
    shape = trimesh.creation.icosphere(subdivisions=3, radius=radius)
    shape.vertices *= (1.0, 1.0, flat)
    return as_mesh(shape, x, y, z)


def blanket(rng: np.random.Generator, amplitude: float) -> Mesh:
    """A closed slab whose upper side waves by the amplitude [m] about z = 0."""
    u, v = np.meshgrid(np.linspace(-WIDE / 2, WIDE / 2, 41), np.linspace(-DEEP / 2, DEEP / 2, 31), indexing="ij")
    phase, wave = rng.uniform(0, 6.3, 2), rng.uniform(5.0, 14.0, 2)
    top = amplitude * np.sin(wave[0] * u + phase[0]) * np.cos(wave[1] * v + phase[1])
    count = u.size
    index = np.arange(count).reshape(u.shape)
    a, b, c, d = (index[i, j].ravel() for i, j in [np.s_[:-1, :-1], np.s_[1:, :-1], np.s_[1:, 1:], np.s_[:-1, 1:]])
    upper = np.concatenate([np.c_[a, b, c], np.c_[a, c, d]])
    ring = np.concatenate([index[:, 0], index[-1, 1:], index[-2::-1, -1], index[0, -2:0:-1]])
    after = np.roll(ring, -1)
    side = np.concatenate([np.c_[ring, ring + count, after + count], np.c_[ring, after + count, after]])
    points = np.concatenate(
        [np.c_[u.ravel(), v.ravel(), top.ravel()], np.c_[u.ravel(), v.ravel(), 0 * u.ravel() - 0.3]]
    )
    return Mesh.of(points, np.concatenate([upper, upper[:, ::-1] + count, side]))


def stool() -> list[Mesh]:
    """A seat on four legs, 30 cm high: hollow underneath."""
    legs = [block((x - 0.02, y - 0.02, 0.0), (x + 0.02, y + 0.02, 0.27)) for x in (-0.15, 0.15) for y in (-0.15, 0.15)]
    return [block((-0.18, -0.18, 0.27), (0.18, 0.18, 0.3)), *legs]


def objects(kind: str, rng: np.random.Generator) -> list[Mesh]:
    """Closed solids of one object, turned at random."""
    size = float(rng.uniform(0.05, 0.2))
    solids = {
        "ball": lambda: [ball(size)],
        "block": lambda: [block((-size, -0.6 * size, 0.0), (size, 0.6 * size, 0.5 * size))],
        "bar": lambda: [block((-0.3, -0.01, 0.0), (0.3, 0.01, 0.02))],
        "bottle": lambda: [rod(0.3 * size, 0.0, 2.0 * size, 0.0, 0.0)],
        "stool": stool,
        "mug": lambda: [rod(0.04, 0.0, 0.1, 0.0, 0.0), block((0.03, -0.006, 0.02), (0.075, 0.006, 0.08))],
    }[kind]()
    tilt = trimesh.transformations.rotation_matrix(
        rng.uniform(0, 0.5) if kind in ("block", "bottle", "mug") else 0.0, (1, 0, 0)
    )
    pose = np.eye(4)
    pose[:3, :3] = about_z(float(rng.uniform(0, 6.3))) @ tilt[:3, :3]
    middle = pose[:3, :3] @ Mesh.concatenate(solids).vertices.mean(axis=0)
    pose[:3, 3] = -middle
    return [solid.transformed(pose) for solid in solids]


def neighbours(rng: np.random.Generator) -> list[Mesh]:
    """Closed solids on and over the support: pillows, books, thin rods, a lamp, a board above."""
    x, y = rng.uniform(-0.5, 0.5, 6), rng.uniform(-0.4, 0.4, 6)
    height = float(rng.uniform(0.12, 0.6))
    shade = trimesh.creation.cone(radius=0.15, height=0.15, sections=24)
    solids = [
        ball(0.2, x[0], y[0], 0.05, flat=0.4),
        block((x[1] - 0.1, y[1] - 0.07, -0.01), (x[1] + 0.1, y[1] + 0.07, 0.06)),
        rod(0.004, -0.02, 0.5, x[2], y[2]),
        rod(0.006, -0.02, 0.3, x[3], y[3]),
        as_mesh(shade, x[3], y[3], 0.3),
        block((x[4] - 0.3, y[4] - 0.2, height), (x[4] + 0.3, y[4] + 0.2, height + 0.02)),
        block((-WIDE / 2, DEEP / 2 - 0.003, -0.3), (WIDE / 2, DEEP / 2, 0.5)),
    ]
    return [solid for solid in solids if rng.random() < 0.7]


@dataclass(frozen=True, eq=False, slots=True)
class Scene:
    """A support with what is on and over it."""

    mesh: Mesh
    support: np.ndarray

    def start(self, item: Mesh, aim: tuple[float, float] = (0.0, 0.0), polygon: np.ndarray = SQUARE) -> Start | None:
        caster = Raycaster(self.mesh)
        search = PlacementSearch(self.mesh, caster, self.support, item)
        return set_down(search, Clearance(item, self.mesh, caster), [Region(polygon, np.array(aim))], GAP)


def scene_of(support: Mesh, others: list[Mesh]) -> Scene:
    mesh = Mesh.concatenate([support, *others])
    return Scene(mesh, np.arange(len(mesh.faces)) < len(support.faces))


def dropped(kind: str, seed: int, amplitude: float) -> tuple[Mesh, list[Mesh], list[Mesh], Start | None]:
    """A random support, closed solids on it, those of an object, and where it is set down."""
    rng = np.random.default_rng(seed)
    support, others, solids = blanket(rng, amplitude), neighbours(rng), objects(kind, rng)
    aim = float(rng.uniform(-0.4, 0.4)), float(rng.uniform(-0.3, 0.3))
    return support, others, solids, scene_of(support, others).start(Mesh.concatenate(solids), aim)


def moved(mesh: Mesh, start: Start) -> Mesh:
    pose = np.eye(4)
    pose[:3, 3] = start.spot.x, start.spot.y, start.height
    return mesh.transformed(pose)


def column_gap(scene: Mesh, item: Mesh, step: float) -> float:
    """Smallest vertical gap on columns through the object [m]."""
    low, high = item.bounds
    x, y = np.meshgrid(np.arange(low[0], high[0], step), np.arange(low[1], high[1], step))
    below = np.c_[x.ravel(), y.ravel(), np.full(x.size, low[2] - 0.5)]
    under = Raycaster(item).cast(below, np.tile([0.0, 0.0, 1.0], (len(below), 1)))
    start = under.position[under.face >= 0]
    return float(Raycaster(scene).cast(start, np.tile([0.0, 0.0, -1.0], (len(start), 1))).distance.min())


def surface_points(mesh: Mesh, spacing: float) -> np.ndarray:
    """Points on all faces, no two further apart than the spacing [m]."""
    vertices, _ = trimesh.remesh.subdivide_to_size(mesh.vertices, mesh.faces, spacing, max_iter=20)
    return np.asarray(vertices)


def depth(points: np.ndarray, solids: list[Mesh]) -> float:
    """How far the deepest point lies in one of the closed solids [m]; negative: outside of all."""
    return max((float(-MeshDistance(solid)(points).min()) for solid in solids), default=-np.inf)


@pytest.mark.slow
@pytest.mark.long
@settings(max_examples=15)
@example("bottle", 190, 2.0**-7)  # its side, steeper than 1, is nearest to a slope
@given(
    st.sampled_from(KINDS),
    st.integers(0, 10_000),
    st.floats(0.0, 0.03),
)
def test_every_start_is_clear(kind, seed, amplitude):
    """The closest point is 1 cm above what is beneath it, none is closer, and no solid reaches into another one."""
    support, others, solids, start = dropped(kind, seed, amplitude)
    scene, item = scene_of(support, others), Mesh.concatenate(solids)
    assume(start is not None)  # so full that nothing is free: judged by the tests below
    assert start is not None
    placed = moved(item, start)
    assert start.gap == pytest.approx(GAP, abs=1e-4)
    # columns never see less than the exact gap, but for rounding; they see at most what slopes of 8 hide in 0.5 mm
    assert GAP - 1e-4 <= column_gap(scene.mesh, placed, 0.0005) <= GAP + 0.004
    here = [moved(solid, start) for solid in solids]
    assert depth(surface_points(placed, 0.01), [support, *others]) < 1e-4
    assert depth(surface_points(scene.mesh, 0.05), here) < 1e-4


def test_two_edges_that_cross_count():
    """A bar across a roof's ridge touches it between all vertices of both: still 1 cm, though both are coarse."""
    roof = Mesh.of(
        np.array([[-0.3, -0.1, 0], [0.3, -0.1, 0], [0.3, 0.1, 0], [-0.3, 0.1, 0], [-0.3, 0, 0.05], [0.3, 0, 0.11]]),
        np.array([[0, 1, 5], [0, 5, 4], [2, 3, 4], [2, 4, 5], [1, 2, 5], [3, 0, 4], [0, 3, 2], [0, 2, 1]]),
    )
    bar = block((-0.02, -0.1, -0.01), (0.02, 0.1, 0.01))
    scene = scene_of(roof, [])
    start = scene.start(bar)
    assert start is not None
    # the ridge climbs 0.06 in 0.6 m: under the bar's higher long edge it is at 0.08 + 0.1 x
    ridge = 0.08 + 0.1 * (start.spot.x + 0.02)
    assert start.height - 0.01 - ridge == pytest.approx(GAP, abs=1e-4)


def test_thin_rods_between_the_samples_are_not_cut():
    """A plate of 60 cm on a table with a forest of wires of 2 mm: rays 2 cm apart miss them, the plate does not."""
    rng = np.random.default_rng(3)
    wires = [rod(0.001, -0.01, 0.2, x, y) for x, y in rng.uniform((-0.6, -0.4), (0.1, 0.4), (12, 2))]
    scene = scene_of(block((-0.8, -0.45, -0.03), (0.8, 0.45, 0.0)), wires)
    polygon = np.array([[-0.8, -0.45], [0.8, -0.45], [0.8, 0.45], [-0.8, 0.45]])
    plate = block((-0.3, -0.3, -0.01), (0.3, 0.3, 0.01))
    start = scene.start(plate, (-0.3, 0.0), polygon)
    assert start is not None
    assert depth(surface_points(moved(plate, start), 0.02), wires) < 0
    assert all(depth(wire.vertices, [moved(plate, start)]) < 0 for wire in wires)


def test_an_upright_sheet_is_in_the_way():
    """Rays along gravity never meet a wall without thickness; a ball aimed at its foot stays on one side of it."""
    wall = Mesh.of(np.array([[-1.0, 0.1, -0.1], [1, 0.1, -0.1], [1, 0.1, 1], [-1, 0.1, 1]]), [[0, 1, 2], [0, 2, 3]])
    scene = scene_of(block((-0.6, -0.45, -0.03), (0.6, 0.45, 0.0)), [wall])
    start = scene.start(ball(0.1), (0.0, 0.1))
    assert start is not None
    assert abs(start.spot.y - 0.1) >= 0.1
    assert np.hypot(start.spot.x, start.spot.y - 0.1) < 0.12


def test_a_stool_stands_over_a_pillow():
    """What is lower than the seat may lie between the legs; only the stool's middle has to be over the support."""
    scene = scene_of(block((-0.6, -0.45, -0.1), (0.6, 0.45, 0.0)), [ball(0.1, 0.0, 0.0, 0.02, flat=0.5)])
    start = scene.start(Mesh.concatenate(stool()))
    assert start is not None
    assert np.hypot(start.spot.x, start.spot.y) < 0.12
    assert start.height == pytest.approx(GAP, abs=1e-4)


def test_level_ground_goes_before_a_step():
    """On a support of two levels a tray goes wholly on one of them, not across the step where it was aimed at."""
    support = Mesh.concatenate(
        [block((-0.6, -0.45, -0.3), (0.0, 0.45, 0.0)), block((0.0, -0.45, -0.3), (0.6, 0.45, 0.2))]
    )
    start = scene_of(support, []).start(block((-0.15, -0.1, 0.0), (0.15, 0.1, 0.02)))
    assert start is not None
    assert abs(start.spot.x) > 0.1
