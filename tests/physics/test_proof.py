"""The proof of rest accepts what a drop came to, and nothing that was moved by hand afterwards."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Literal

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from dcap.scene.types.mesh import Mesh
from solver.certificate import CertificateRow, PointForces
from solver.config import SolverConfig
from solver.errors import UnstableStep
from solver.model.bodies import Body, Model, SignedDistance, SoftBody
from solver.settle import settle
from tasks.bodies.overlap import largest_push, nearest, overlap_row, sides_of, worst_row
from tasks.bodies.proof import contact_proof, imbalances, largest_gap, proven

Points = NDArray[np.float64]


def scenes(lab) -> dict[str, tuple[Body, ...]]:
    """Bodies of each kind on bodies of each kind, the one that is moved first; "tag" and "cap" are bonded to it."""
    slab = lab.soft("slab", lab.Box(np.array([0.2, 0.2, 0.06])), [0, 0, -0.03], E=3e4, cell=0.0125, fixed=True,
                    held=np.s_[:, :, 0], loaded=True)  # fmt: skip
    cube = lab.soft("cube", lab.Box(np.full(3, 0.06)), [0, 0, 0.0305], E=2e4, rho=300.0, cell=0.0125)
    return {
        "a rigid block on a floor": (
            lab.rigid("block", lab.Box(np.full(3, 0.05)), [0, 0, 0.0252], mass=0.5),
            lab.floor(),
        ),
        "a rigid block on an open floor": (
            lab.rigid("block", lab.Box(np.full(3, 0.05)), [0, 0, 0.0252], mass=0.5),
            top_only(lab.floor()),
        ),
        "a rigid plate on an open floor": (
            lab.rigid("plate", lab.Box(np.array([0.05, 0.05, 0.0018])), [0, 0, 0.0011], mass=0.1),
            top_only(lab.floor()),
        ),
        "a rigid ball on foam": (
            lab.rigid("ball", lab.Capsule(0.04, 0.0), [0, 0, 0.0405], mass=0.3, rolling=1e-3),
            slab,
        ),
        "a soft cube on a floor": (cube, lab.floor()),
        "a soft cube on foam": (
            lab.soft("cube", lab.Box(np.full(3, 0.06)), [0, 0, 0.0305], E=3e4, rho=200.0, cell=0.0125),
            slab,
        ),
        "a block with a bonded one on foam": (
            lab.rigid("tag", lab.Box(np.full(3, 0.03)), [0, 0, 0.0555], mass=0.1, edge=0.01),
            lab.rigid("block", lab.Box(np.full(3, 0.04)), [0, 0, 0.0205], mass=0.2, edge=0.01),
            slab,
        ),
        "a soft cube with a bonded cap": (
            lab.rigid("cap", lab.Box(np.array([0.06, 0.06, 0.01])), [0, 0, 0.0655], mass=0.05, edge=0.01),
            cube,
            lab.floor(),
        ),
    }  # fmt: skip


def top_only(floor):
    """The floor as scans have it: its upper side alone."""
    corner = floor.vertices[floor.faces]
    return replace(floor, faces=floor.faces[(corner[..., 2] > -1e-9).all(axis=1)])


def bonds_of(bodies: tuple[Body, ...]) -> tuple[tuple[str, str], ...]:
    """The tag or cap with what it is bonded to."""
    return ((bodies[0].name, bodies[1].name),) if bodies[0].name in ("tag", "cap") else ()


def lifted(distance: float) -> Callable[[Points], Points]:
    """Moved up, or down, by a distance [m]."""
    return lambda points: points + np.array([0.0, 0.0, distance])


def turned(points: Points) -> Points:
    """Stood on an edge."""
    middle = points.mean(axis=0)
    return np.asarray((points - middle) @ Rotation.from_rotvec([0.6, 0.0, 0.0]).as_matrix().T + middle)


def moves(bound: float) -> dict[str, Callable[[Points], Points]]:
    """What is done to a body by hand; the least lift is twice the gap that is allowed [m]."""
    return {
        **{f"lifted by {1e3 * d:.2f} mm": lifted(d) for d in (2.0 * bound, 4.0 * bound, 5e-3, 2e-2)},
        **{f"pushed in by {1e3 * d:.2f} mm": lifted(-d) for d in (2.0 * bound, 5e-3)},
        "stood on an edge": turned,
        "moved beside": lambda points: points + np.array([0.5, 0.0, 0.0]),
        "made smaller": lambda points: points.mean(axis=0) + 0.8 * (points - points.mean(axis=0)),
    }


def moved_by_hand(ends: list[Points], bound: float, *, bonded: bool) -> Iterator[tuple[str, list[Points]]]:
    """Final surfaces, changed: the first body is moved, or the support of all is gone."""
    for what, move in moves(REACH if bonded else bound).items():
        yield what, [move(ends[0]), *ends[1:]]
    yield "without support", [*ends[:-1], ends[-1] - [0.0, 0.0, 1.0]]
    yield "lowered by its height", [lifted(-float(np.ptp(ends[0][:, 2])))(ends[0]), *ends[1:]]


REACH = 1e-3
"""How far the two ends of a bond may be apart [m]."""


@pytest.mark.slow
@pytest.mark.parametrize("method", ["tl", pytest.param("mls", marks=pytest.mark.long)])
def test_a_state_that_was_moved_is_refuted(lab, method: Literal["tl", "mls"]) -> None:
    """Lifted from twice the gap on, pushed in, turned, or with its support gone: none holds; as it was, each does."""
    missed, tried = [], 0
    for name, bodies in scenes(lab).items():
        if method == "mls" and not any(isinstance(body, SoftBody) for body in bodies):
            continue
        model = Model(bodies, np.array([0.0, 0.0, -9.81]), bonds=bonds_of(bodies))
        result = proven(model, settle(model, SolverConfig(threads=2, method=method)))
        assert result.verdict == "at_rest", (name, result.warnings)
        assert result.certificate.proof is not None
        assert result.certificate.proof.holds
        ends, bound = [one.vertices for one in result.bodies], largest_gap(result.certificate)
        for what, changed in moved_by_hand(ends, bound, bonded=bool(model.bonds)):
            if "ball" in name and "edge" in what:
                continue  # it has none
            tried += 1
            surfaces = [Mesh.of(x, b.faces) for x, b in zip(changed, model.bodies, strict=True)]
            if contact_proof(model, surfaces, result.forces, bound, {}).holds:
                missed.append(f"{name}, {what}")
        check_forces(model, result, missed, name)
    assert missed == []
    assert tried >= (87 if method == "tl" else 54)


def check_forces(model: Model, result, missed: list[str], name: str) -> None:
    """Forces that are gone, too small, or no numbers are no rest; the verdict and a message say so."""
    forces = result.forces
    last = np.arange(len(forces.force))[:, None] == len(forces.force) - 1
    for what, changed in {
        "without forces": forces.force[:0],
        "with half the force": 0.5 * forces.force,
        "with a force that is no number": np.where(last, np.nan, forces.force),
        "with forces that pull": -forces.force,
    }.items():
        count = len(changed)
        other = replace(forces, a=forces.a[:count], b=forces.b[:count], position=forces.position[:count],
                        force=changed, bonded=forces.bonded[:count])  # fmt: skip
        if "no number" in what:
            with pytest.raises(UnstableStep, match=r"a force between .* is not finite"):
                proven(model, replace(result, forces=other))
            continue
        found = proven(model, replace(result, forces=other))
        if found.verdict != "no_equilibrium" or not found.warnings[-1]:
            missed.append(f"{name}, {what}")
    if any(isinstance(body, SoftBody) for body in model.bodies):
        found = proven(model, replace(result, contacts=tuple(replace(row, area_m2=0.0) for row in result.contacts)))
        if found.verdict != "no_equilibrium" or "has no area" not in found.warnings[-1]:
            missed.append(f"{name}, without area")
    for name, material in result.material.items():
        lost = {**result.material, name: replace(material, displacement=np.full_like(material.displacement, np.nan))}
        with pytest.raises(UnstableStep, match=r"the material of body .* is not finite"):
            proven(model, replace(result, material=lost))
    ends = [replace(result.bodies[0], vertices=np.full_like(result.bodies[0].vertices, np.nan)), *result.bodies[1:]]
    with pytest.raises(UnstableStep, match=r"the surface of body .* is not finite"):
        proven(model, replace(result, bodies=tuple(ends)))


def acting(
    lab,
    *where: tuple[float, float, float],
    pull: float = 0.0,
    inside_out: int | None = None,
    lift: float = 0.0,
    bonded: bool = False,
):
    """A block of 5 cm and 0.5 kg on a floor, its weight carried at so many places alike, and the proof of that once it
    is lifted [m]; `pull` of its weight pulls there, too, and what pushes is as much more."""
    block, floor = lab.rigid("block", lab.Box(np.full(3, 0.05)), [0, 0, 0.025], mass=0.5), lab.floor()
    model = Model((block, floor), np.array([0.0, 0.0, -9.81]))
    each = 0.5 * 9.81 / max(len(where), 1)
    position = np.array([*where, *(where if pull else ())], dtype=float).reshape(-1, 3)
    count = len(position)
    up = np.where(np.arange(count) < len(where), (1.0 + pull) * each, -pull * each)
    forces = PointForces(np.zeros(count, int), np.ones(count, int), position, up[:, None] * np.array([0.0, 0.0, 1.0]),
                         np.full(count, bonded))  # fmt: skip
    surfaces = [Mesh.of(lifted(lift)(block.vertices), block.faces), Mesh.of(floor.vertices, floor.faces)]
    if inside_out is not None:
        surfaces[inside_out] = Mesh.of(surfaces[inside_out].vertices, surfaces[inside_out].faces[:, ::-1])
    return contact_proof(model, surfaces, forces, 3e-4, {})


FEET = [(x, y, 0.0) for x in (-0.017, 0.017) for y in (-0.013, 0.013)]  # on no edge of a triangle


def test_forces_at_feet_hold_a_block(lab) -> None:
    """Of contacts, and of bonds."""
    assert acting(lab, *FEET).holds
    assert acting(lab, *FEET, bonded=True).holds


@pytest.mark.parametrize(
    ("where", "lift", "bonded"),
    [
        ([], 0.0, False),
        (FEET[:1], 0.0, False),  # the whole weight at one corner turns it over
        ([(x, y, -2e-3) for x, y, _ in FEET], 0.0, False),
        ([(x, y, 0.05) for x, y, _ in FEET], 0.0, False),  # on its own top, far from the floor
        (FEET, 2e-3, False),
        (FEET, 5e-3, True),  # a bond across a gap
    ],
)
def test_forces_that_cannot_hold_it_prove_nothing(lab, where, lift: float, bonded: bool) -> None:
    """None at all, all at one corner, away from the surfaces, across a gap."""
    assert not acting(lab, *where, lift=lift, bonded=bonded).holds


@pytest.mark.slow
@pytest.mark.parametrize("which", ["every", "every second"])
def test_an_open_floor_may_be_inside_out(lab, which: str) -> None:
    """Scans may have all faces turned, or some: what rests there rests all the same."""
    bodies = scenes(lab)["a rigid block on an open floor"]
    model = Model(bodies, np.array([0.0, 0.0, -9.81]))
    result = settle(model, SolverConfig(threads=2))
    block, floor = (Mesh.of(end.vertices, body.faces) for end, body in zip(result.bodies, bodies, strict=True))
    faces = floor.faces.copy()
    faces[:: 1 if which == "every" else 2] = faces[:: 1 if which == "every" else 2, ::-1]
    surfaces = [block, Mesh.of(floor.vertices, faces)]
    assert contact_proof(model, surfaces, result.forces, 3e-4, {}).holds


@pytest.mark.parametrize("turned", [0, 1])
def test_a_closed_surface_that_is_inside_out_proves_as_much(lab, turned: int) -> None:
    """The block's or the floor's."""
    assert acting(lab, *FEET, inside_out=turned).holds


@pytest.mark.parametrize(("upright", "depth"), [(True, 0.03), (False, 1.71e-3), (False, 1e-3)])
def test_thin_things_may_not_lie_in_each_other(lab, upright: bool, depth: float) -> None:
    """A plate of 1.9 mm through a board of 1.9 mm, or in it: no surface lies deeper than 0.95 mm there."""
    size = np.array([0.05, 0.0019, 0.06] if upright else [0.06, 0.05, 0.0019])
    plate = lab.rigid("plate", lab.Box(size), [0, 0, 0.5 * size[2]], mass=0.1)
    board = replace(lab.rigid("board", lab.Box(np.array([0.2, 0.2, 0.0019])), [0, 0, -0.00095]), fixed=True)
    model = Model((plate, board), np.array([0.0, 0.0, -9.81]))
    surfaces = [Mesh.of(lifted(-depth)(plate.vertices), plate.faces), Mesh.of(board.vertices, board.faces)]
    row = overlap_row(model, surfaces, 3e-4, 1e-3)
    assert not row.holds
    assert row.threshold == pytest.approx(0.0019 / 4.0, rel=0.01)


def test_the_overlap_of_dense_and_long_triangles_is_found_in_seconds(lab) -> None:
    """A cylinder of a thousand slivers, as long as itself, that stands 2 mm deep in a floor."""
    angle = np.linspace(0.0, 2.0 * np.pi, 1001)[:-1]
    ring = 0.2 * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    vertices = np.concatenate([np.column_stack([ring, np.full(1000, z)]) for z in (0.0, 1.0)])
    at = np.arange(1000)
    after = (at + 1) % 1000
    sides = np.concatenate(
        [np.stack([at, after, after + 1000], axis=1), np.stack([at, after + 1000, at + 1000], axis=1)]
    )
    fan = np.stack([np.zeros(998, int), at[1:-1], at[2:]], axis=1)
    faces = np.concatenate([sides, fan[:, ::-1], fan + 1000]).astype(np.int32)
    block, floor = lab.rigid("block", lab.Box(np.full(3, 0.05)), [0, 0, 0.025]), lab.floor()
    model = Model((replace(block, vertices=vertices, faces=faces), floor), np.array([0.0, 0.0, -9.81]))
    row = overlap_row(
        model, [Mesh.of(lifted(-2e-3)(vertices), faces), Mesh.of(floor.vertices, floor.faces)], 3e-4, 1e-3
    )
    assert row.value == pytest.approx(2e-3, rel=0.01)


def test_forces_that_pull_hold_nothing(lab) -> None:
    """Twice the weight pushes at the feet and once the weight pulls there: in balance, but nothing pulls at a floor."""
    assert acting(lab, *FEET).imbalance.value < 1e-9
    assert acting(lab, *FEET, pull=1.0).imbalance.value == pytest.approx(1.0)


SIDE = [(0.025, y, z) for y in (-0.013, 0.013) for z in (0.0, 1e-4)]


@pytest.mark.parametrize(
    ("where", "lift", "thick"),
    [
        ([(x, y, 0.0) for x, y, _ in FEET], -0.05, 0.1),  # sunk by its height: its top carries it
        ([(x, y, -0.02) for x, y, _ in FEET], -0.02, 0.02),  # through a board: the underside of that carries it
        ([(x, y, -5e-4) for x, y, _ in FEET], -5e-4, 5e-4),  # into a sheet
        (SIDE, -2e-3, 0.1),  # by its side walls, at the level of the floor
        (SIDE, -0.02, 0.1),
    ],
)
@pytest.mark.parametrize("soft", [False, True])
def test_a_block_that_is_pushed_in_proves_nothing(lab, where, lift: float, thick: float, soft: bool) -> None:
    """Wherever its surface meets that of what it is pushed into, forces there do not push at both."""
    assert not on_board(lab, where, lift, thick, soft).holds


@pytest.mark.parametrize("soft", [False, True])
def test_a_block_on_a_board_is_held(lab, soft: bool) -> None:
    """The same block and board, and the same number of forces, where they belong."""
    assert on_board(lab, FEET, 0.0, 0.02, soft).holds


def test_a_soft_block_on_one_corner_is_not_held(lab) -> None:
    """Torque counts for soft bodies as it does for rigid ones."""
    assert not on_board(lab, [(0.02, 0.018, 0.0)], 0.0, 0.02, True).holds


def test_friction_without_a_normal_force_holds_nothing(lab) -> None:
    """A block beside a wall is not carried by forces along that."""
    assert not on_board(lab, [(0.025, y, z) for y in (-0.013, 0.013) for z in (0.019, 0.031)], 0.0, 0.1, False,
                        wall=True).holds  # fmt: skip


@pytest.mark.parametrize("gap", [6e-4, 9e-4])
@pytest.mark.parametrize("cell", [0.02, 0.03])
def test_coarse_triangles_of_a_soft_block_do_not_let_it_hover(lab, gap: float, cell: float) -> None:
    """Its own triangles may be chords of what it bends to, but the floor is exact."""
    block = lab.soft("block", lab.Box(np.array([0.12, 0.12, 0.06])), [0, 0, 0.03 + gap], E=2e4, rho=300.0, cell=cell)
    model = Model((block, lab.floor()), np.array([0.0, 0.0, -9.81]))
    assert not held_from_below(model, block.vertices[block.vertices[:, 2] < gap + 1e-6]).gap_m.holds


def test_an_open_block_may_not_hang_below_an_open_floor(lab) -> None:
    """Sunk by its height, where its top meets the floor: a missing side hides from neither where the inside is."""
    block, floor = lab.rigid("block", lab.Box(np.full(3, 0.05)), [0, 0, 0.025], mass=0.5), top_only(lab.floor())
    middle = block.vertices[block.faces].mean(axis=1)
    block = replace(block, faces=block.faces[middle[:, 0] < 0.0249])
    corners = np.array([[-2.0, -2.5, 0.0], [3.0, -2.0, 0.0], [-2.0, 3.0, 0.0]])
    large = replace(floor, vertices=corners, faces=np.array([[0, 1, 2]], np.int32))  # farther than distance is sampled
    for support in (floor, large):
        model = Model((block, support), np.array([0.0, 0.0, -9.81]))
        assert held_from_below(model, np.array(FEET)).holds
        assert not held_from_below(model, np.array(FEET), -0.05).holds


def held_from_below(model: Model, where: Points, raised: float = 0.0):
    """The proof where the weight of the first body, raised [m], is carried by the second at some places alike."""
    count = len(where)
    force = np.tile([0.0, 0.0, model.bodies[0].mass * 9.81 / count], (count, 1))
    forces = PointForces(np.zeros(count, int), np.ones(count, int), where, force, np.zeros(count, bool))
    ends = [lifted(raised)(model.bodies[0].vertices), *(body.vertices for body in model.bodies[1:])]
    surfaces = [Mesh.of(x, body.faces) for x, body in zip(ends, model.bodies, strict=True)]
    return contact_proof(model, surfaces, forces, 3e-4, {})


def test_squeezing_carries_no_weight(lab) -> None:
    """A light block in the air between a wall and a heavy box, which push it from both sides."""
    block = lab.rigid("block", lab.Box(np.full(3, 0.05)), [0, 0, 0.025], mass=0.05)
    wall = replace(lab.rigid("wall", lab.Box(np.array([0.02, 0.2, 0.2])), [-0.035, 0, 0.025]), fixed=True)
    box = lab.rigid("box", lab.Box(np.full(3, 0.2)), [0.125, 0, 0.025], mass=20.0)
    model = Model((block, wall, box), np.array([0.0, 0.0, -9.81]))
    place = [[side * 0.025, y, z] for side in (-1.0, 1.0) for y in (-0.013, 0.013) for z in (0.02, 0.03)]
    force = [[-side * 15.0, 0.0, 0.0] for side in (-1.0, 1.0) for _ in range(4)]
    forces = PointForces(np.zeros(8, int), np.repeat([1, 2], 4), np.array(place), np.array(force), np.zeros(8, bool))
    surfaces = [Mesh.of(body.vertices, body.faces) for body in model.bodies]
    shares = list(imbalances(model, surfaces, forces, np.ones(8, bool), {}))
    assert shares[0] == pytest.approx(1.0)


@pytest.mark.parametrize(("of_faces", "holds"), [(0.5, True), (0.05, False)])
def test_friction_is_that_of_the_faces_that_touch(lab, of_faces: float, holds: bool) -> None:
    """Feet that push apart with eight tenths of their load need friction, which slippery faces do not have."""
    block, floor = (
        replace(body, static_friction=0.5, dynamic_friction=0.5, face_friction=np.tile(row, (len(body.faces), 1)))
        for row in ([of_faces, of_faces, 0.0],)
        for body in (lab.rigid("block", lab.Box(np.full(3, 0.05)), [0, 0, 0.025], mass=0.5), lab.floor())
    )
    model = Model((block, floor), np.array([0.0, 0.0, -9.81]))
    each = 0.5 * 9.81 / 4.0
    force = np.array([[0.8 * np.sign(x) * each, 0.0, each] for x, _, _ in FEET])
    forces = PointForces(np.zeros(4, int), np.ones(4, int), np.array(FEET), force, np.zeros(4, bool))
    surfaces = [Mesh.of(body.vertices, body.faces) for body in model.bodies]
    assert contact_proof(model, surfaces, forces, 3e-4, {}).holds == holds


def test_torque_acts_about_the_material_of_what_bends(lab) -> None:
    """A soft block is held under its centre of mass, wherever its surface would put that."""
    block = lab.soft("block", lab.Box(np.full(3, 0.05)), [0, 0, 0.025], E=2e4, rho=4000.0, cell=0.0125)
    model = Model((block, lab.floor()), np.array([0.0, 0.0, -9.81]))
    surfaces = [Mesh.of(body.vertices, body.faces) for body in model.bodies]
    where = np.array(FEET) + np.array([0.005, 0.0, 0.0])
    force = np.tile([0.0, 0.0, block.mass * 9.81 / 4.0], (4, 1))
    forces = PointForces(np.zeros(4, int), np.ones(4, int), where, force, np.zeros(4, bool))
    moved = {"block": block.center_of_mass + np.array([0.005, 0.0, 0.0])}
    assert contact_proof(model, surfaces, forces, 3e-4, moved).imbalance.holds
    assert not contact_proof(model, surfaces, forces, 3e-4, {}).imbalance.holds


def test_a_row_that_is_no_number_is_the_worst() -> None:
    """Wherever it stands among others."""
    good, nan = CertificateRow.at_most(0.0, 1.0), CertificateRow.at_most(float("nan"), 1.0)
    assert worst_row([good, nan, good]) is nan
    assert not nan.holds


def on_board(lab, where, lift: float, thick: float, soft: bool, *, wall: bool = False):
    """The proof of a block of 5 cm, lifted from a closed board, or next to a wall, that carries its weight upward at so
    many places alike."""
    block = lab.rigid("block", lab.Box(np.full(3, 0.05)), [0, 0, 0.025], mass=0.5)
    if soft:
        block = lab.soft("block", lab.Box(np.full(3, 0.05)), [0, 0, 0.025], E=2e4, rho=4000.0, cell=0.0125)
    middle = [0.025 + 0.5 * thick, 0, 0] if wall else [0, 0, -0.5 * thick]
    size = np.array([thick, 0.3, 0.3] if wall else [0.3, 0.3, thick])
    board = replace(lab.rigid("board", lab.Box(size), middle, spacing=0.004), fixed=True)
    model = Model((block, board), np.array([0.0, 0.0, -9.81]))
    count = len(where)
    force = np.tile([0.0, 0.0, block.mass * 9.81 / count], (count, 1))
    forces = PointForces(np.zeros(count, int), np.ones(count, int), np.array(where, dtype=float), force,
                         np.zeros(count, bool))  # fmt: skip
    surfaces = [Mesh.of(lifted(lift)(block.vertices), block.faces), Mesh.of(board.vertices, board.faces)]
    return contact_proof(model, surfaces, forces, 3e-4, {})


@pytest.mark.parametrize(("start", "holds"), [(0.004, False), (-0.003, True)])
def test_a_block_may_not_end_in_a_wall_that_it_does_not_push(lab, start: float, holds: bool) -> None:
    """The board carries it and nothing acts at the wall, 3 mm of which it takes up; a scan may have it there before."""
    moved = np.array([start + 0.003, 0.0, 0.0])
    block = lab.rigid("block", lab.Box(np.full(3, 0.05)), [0, 0, 0.025], mass=0.5)
    board, wall = (
        replace(lab.rigid(name, lab.Box(np.array(size)), middle), fixed=True)
        for name, size, middle in (
            ("board", [0.3, 0.3, 0.02], [0, 0, -0.01]),
            ("wall", [0.02, 0.2, 0.2], [0.035 + start, 0, 0.101]),
        )
    )
    model = Model((block, board, wall), np.array([0.0, 0.0, -9.81]))
    force = np.tile([0.0, 0.0, block.mass * 9.81 / len(FEET)], (len(FEET), 1))
    forces = PointForces(np.zeros(4, int), np.ones(4, int), np.array(FEET) + moved, force, np.zeros(4, bool))
    ends = [block.vertices + moved, board.vertices, wall.vertices]
    surfaces = [Mesh.of(x, body.faces) for x, body in zip(ends, model.bodies, strict=True)]
    proof = contact_proof(model, surfaces, forces, 3e-4, {})
    assert proof.imbalance.holds
    assert proof.holds == holds
    if not holds:
        assert proof.overlap_m.value == pytest.approx(3e-3, rel=0.01)


def test_a_tip_is_pushed_by_any_force_between_the_normals_of_its_faces() -> None:
    """An octahedron on its tip: no face of it looks straight down, but a force that holds it up pushes in full."""
    vertices = np.concatenate([np.eye(3), -np.eye(3)])
    faces = np.array([[0, 1, 2], [1, 3, 2], [3, 4, 2], [4, 0, 2], [1, 0, 5], [3, 1, 5], [4, 3, 5], [0, 4, 5]], np.int32)
    mesh = Mesh.of(vertices, faces)
    force = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0], [1.0, 0.0, 0.0]])
    near = nearest(mesh, np.tile([0.0, 0.0, -1.0], (3, 1)))
    unknown = SignedDistance(np.zeros(3), 1.0, np.zeros((3, 3, 3), np.float32))  # the solid is closed
    up, down, along = largest_push(sides_of(mesh, mesh, unknown, near), near, force)
    assert up == pytest.approx(1.0)
    assert down == pytest.approx(-1.0 / np.sqrt(3.0))
    assert along == pytest.approx(np.sqrt(0.5))
