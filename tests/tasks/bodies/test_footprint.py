"""The predicted contact of an object with what lies beneath it."""

import numpy as np
import pytest
import trimesh
from box_rooms import block

from dcap.geometry.raycast import Raycaster
from dcap.scene.types.mesh import Mesh
from tasks.bodies.footprint import Descent, Footprint, levelling, slope_below
from tasks.bodies.plan_contact import Heights, felt_compliance, layered_patch

FLOOR = block((-1.0, -1.0, -0.2), (1.0, 1.0, 0.0))
FOAM, RIGID = (np.inf, 1.0 / 2e4), (np.inf, 0.0)
BOARD = block((-0.2, -0.05, 0.01), (0.2, 0.05, 0.03))


def on_foam(item: Mesh, weight: float, *, tilts: bool = True, ground: Mesh = FLOOR) -> Footprint:
    """A rigid object on soft ground."""
    return Descent.of(item, Raycaster(ground), 0.0, tilts=tilts).footprint(weight, ([RIGID], [FOAM, RIGID]))


def sloping(item: Mesh, slope: float) -> Mesh:
    """The object with one end lifted."""
    lift = slope * (item.vertices[:, :1] - item.vertices[:, 0].min())
    return Mesh.of(item.vertices + lift * [0.0, 0.0, 1.0], item.faces)


def sphere(radius: float, height: float) -> Mesh:
    """A fine ball with its lowest point at a height [m]."""
    found = trimesh.creation.icosphere(5, radius)
    return Mesh.of(found.vertices + np.array([0.0, 0.0, radius + height]), found.faces)


def test_an_object_lies_down_on_what_it_meets() -> None:
    """A board that slopes by 2 cm over its length comes down with an end and then lies: all of it will touch, unless it
    is held as it is. Its start is told as it was: the gap of its lower end, the ground below its higher one."""
    board = sloping(BOARD, 0.05)
    held, lying = (on_foam(board, 5.0, tilts=tilts) for tilts in (False, True))
    assert held.high[0] - held.low[0] < 0.3
    assert [lying.low[0], lying.high[0]] == pytest.approx([-0.2, 0.2], abs=0.4 / 40)
    assert Descent.of(board, Raycaster(FLOOR), 0.0, tilts=True).gap == pytest.approx(0.01, abs=1e-3)
    assert lying.on_base[:, :, 2] == pytest.approx(0.0, abs=2e-3)


def test_what_would_fall_over_is_not_laid_down() -> None:
    """A rod on its end, tilted by 40 degrees, touches with its rim."""
    turn = trimesh.transformations.rotation_matrix(np.radians(40.0), [0.0, 1.0, 0.0])
    rod = block((-0.02, -0.02, -0.2), (0.02, 0.02, 0.2)).transformed(turn)
    rod = Mesh.of(rod.vertices - [0.0, 0.0, rod.bounds[0, 2] - 0.01], rod.faces)
    foot = on_foam(rod, 5.0)
    assert foot.half_width < 0.02


@pytest.mark.parametrize("weight", [0.5, 5.0])
def test_a_ball_touches_as_hertz_says(weight: float) -> None:
    """a^3 = 3 W R / 4 E*, and as deep as a^2 / R; the mean half width of a disc under Hertz's pressure is 3 pi / 16 of
    its diameter: rows of length 2 sqrt(a^2 - x^2), weighed with their load pi p0 (a^2 - x^2) / (2 a)."""
    radius = 0.1
    a = (0.75 * weight * radius / 2e4) ** (1 / 3)
    foot = on_foam(sphere(radius, 0.005), weight)
    assert foot.half_width == pytest.approx(9.0 * np.pi / 32.0 * a, rel=0.04)
    assert foot.depth == pytest.approx(a**2 / radius, rel=0.03)


def test_a_rod_touches_along_its_length() -> None:
    """Lying on foam its contact is as long as it is, and narrow; the cells across it follow the width."""
    rod = Mesh.of(*_rod(0.02, 0.3))
    foot = on_foam(rod, 3.0)
    x, _ = foot.contacts[0].across(0)
    assert np.ptp(x) > 0.28
    assert foot.half_width < 0.012


def test_feet_are_seen_one_by_one() -> None:
    """A plate on four feet: the patch is as wide as a foot, its box as wide as the plate."""
    feet = [block((x, y, 0.01), (x + 0.03, y + 0.03, 0.05)) for x in (-0.1, 0.07) for y in (-0.1, 0.07)]
    parts = [*feet, block((-0.1, -0.1, 0.05), (0.1, 0.1, 0.07))]
    count = len(parts[0].vertices)
    faces = np.concatenate([part.faces + k * count for k, part in enumerate(parts)])
    foot = on_foam(Mesh.of(np.concatenate([part.vertices for part in parts]), faces), 5.0)
    assert foot.half_width == pytest.approx(0.015, rel=0.1)
    assert foot.small_side == pytest.approx(0.2, abs=0.01)


def test_on_a_rigid_base_there_is_no_patch() -> None:
    """What may touch within the least visible depth decides where points are."""
    foot = Descent.of(sphere(0.1, 0.005), Raycaster(FLOOR), 0.0, tilts=True).footprint(5.0, ([RIGID], [RIGID]))
    assert not foot.contacts
    assert foot.half_width == pytest.approx(np.sqrt(2 * 0.1 * 5e-4), rel=0.3)


def test_what_hangs_over_an_edge_touches_up_to_it() -> None:
    """A board with two thirds of its length on a bench."""
    bench = block((-1.0, -1.0, -0.2), (0.07, 1.0, 0.0))
    foot = on_foam(BOARD, 5.0, ground=bench)
    assert foot.contacts[0].across(0)[0].max() == pytest.approx(0.07, abs=0.005)


def test_over_a_hole_the_height_that_was_asked_counts() -> None:
    """Nothing is seen below a ball: its patch is that on a level ground there."""
    aside = block((2.0, -1.0, -0.2), (3.0, 1.0, 0.0))
    seen, unseen = (on_foam(sphere(0.1, 0.005), 1.0, ground=ground) for ground in (FLOOR, aside))
    assert unseen.contacts[0].half_width == pytest.approx(seen.contacts[0].half_width, rel=1e-3)


def _rod(radius: float, length: float) -> tuple[np.ndarray, np.ndarray]:
    """A fine cylinder that lies along x, a centimetre above the floor."""
    found = trimesh.creation.cylinder(radius, length, sections=128)
    turn = trimesh.transformations.rotation_matrix(np.pi / 2.0, [0.0, 1.0, 0.0])
    vertices = found.vertices @ turn[:3, :3].T
    return vertices + np.array([0.0, 0.0, radius + 0.01]), found.faces


SOFT, HARD = 1e-4, 1e-6


def test_a_contact_feels_a_thin_layer_little_and_a_thick_one_alone() -> None:
    """Between those limits both count; one layer counts as itself."""
    assert felt_compliance([(0.1, SOFT)], 0.02) == pytest.approx(SOFT)
    assert felt_compliance([(1e-6, HARD), (1.0, SOFT)], 0.02) == pytest.approx(SOFT, rel=1e-3)
    assert felt_compliance([(10.0, SOFT), (1.0, HARD)], 0.02) == pytest.approx(SOFT, rel=1e-2)
    assert HARD < felt_compliance([(0.01, SOFT), (1.0, HARD)], 0.02) < SOFT


def test_a_patch_on_a_thin_soft_layer_is_narrower_than_on_a_thick_one() -> None:
    """A ball on foam over a rigid floor: the floor is felt, the more so the thinner the foam."""
    x = np.linspace(-0.05, 0.05, 64)
    gap, spacing = (x[:, None] ** 2 + x[None, :] ** 2) / 0.2, (x[1] - x[0], x[1] - x[0])
    widths = [
        layered_patch(gap, spacing, 2.0, ([(np.inf, 0.0)], [(depth, SOFT), (np.inf, 0.0)])).touching.sum()
        for depth in (0.005, 0.02, 10.0)
    ]
    assert widths[0] < widths[1] < widths[2]


X, Y = np.linspace(-0.1, 0.1, 21), np.linspace(-0.05, 0.05, 11)


def grid(gap: np.ndarray) -> np.ndarray:
    """Gaps at the places X, Y."""
    return np.broadcast_to(gap, (len(X), len(Y))).copy()


def test_a_plane_has_its_own_slope() -> None:
    """Although its points span no volume."""
    gap = grid(0.02 + 0.1 * X[:, None] - 0.3 * Y[None, :])
    assert slope_below(X, Y, gap, np.array([0.013, -0.007])) == pytest.approx([0.1, -0.3], abs=1e-6)


def test_beside_all_that_carries_there_is_no_facet() -> None:
    """The centre of mass hangs over the edge."""
    gap = grid(np.where(X < 0.0, 0.01, np.nan)[:, None])
    assert slope_below(X, Y, gap, np.array([0.05, 0.0])) is None
    assert slope_below(X, Y, np.full((len(X), len(Y)), np.nan), np.zeros(2)) is None


@pytest.mark.parametrize("slope", [(0.2, 0.0), (0.0, -0.2), (0.1, 0.15)])
def test_a_board_over_a_slope_turns_flush_with_it(slope: tuple[float, float]) -> None:
    """Seen from the board: after the turn its underside is as far from the slope everywhere."""
    board = block((-0.2, -0.1, 0.1), (0.2, 0.1, 0.12))

    def heights_of(turned: Mesh) -> Heights:
        low = turned.vertices[board.vertices[:, 2] < 0.11]
        plane = np.linalg.lstsq(np.column_stack([low[:, :2], np.ones(len(low))]), low[:, 2], rcond=None)[0]
        return lambda plan: (plan @ plane[:2] + plane[2], plan @ np.array(slope))

    lying = board.transformed(levelling(board, np.array([0.0, 0.0, 0.11]), heights_of))
    low = lying.vertices[board.vertices[:, 2] < 0.11]
    assert np.ptp(low[:, 2] - low[:, :2] @ np.array(slope)) < 1e-3
