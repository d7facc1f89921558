"""A scan is mended where it was torn, and left alone where the thing is like that."""

import numpy as np
import pytest
from torn import ball, fine_box, middles, normals, scrap, turned, where, with_hole

from dcap.geometry.raycast import Raycaster
from dcap.geometry.solid.height_map import HeightMap, seen_from_above, surface_across
from dcap.geometry.solid.mending import MOST_LOOKS, look_spacing, mended
from dcap.scene.types.mesh import Mesh

TOP = 0.4
BLOCK = fine_box((-0.4, -0.3, 0.0), (0.4, 0.3, TOP))


def height_at(mesh: Mesh, x: float, y: float) -> float:
    """Of the first surface from above [m]."""
    return float(Raycaster(mesh).cast(np.array([[x, y, 2.0]]), np.array([[0.0, 0.0, -1.0]])).position[0, 2])


def test_what_is_whole_is_not_touched() -> None:
    """No face is added, turned or left out, and there is nothing to tell."""
    found = mended(BLOCK)
    assert not found.changed
    assert np.array_equal(found.mesh.faces, BLOCK.faces)


@pytest.mark.parametrize("underside", [True, False])
def test_a_hole_is_closed_level_with_its_rim(underside: bool) -> None:
    """Whether the inside of the bottom is seen through it or nothing: to a tenth of a millimetre where it is flat. Its
    size is that of the faces that are missing, to one edge of them (25 mm) and one look."""
    torn = with_hole(BLOCK, (0.05, 0.0), (0.16, 0.12))
    torn = torn if underside else where(torn, normals(torn)[:, 2] > -0.5)
    found = mended(torn)
    (hole,) = found.holes
    assert height_at(found.mesh, 0.05, 0.0) == pytest.approx(TOP, abs=1e-4)
    assert hole.sides == pytest.approx((0.16, 0.12), abs=0.03)
    assert (hole.low < (0.05, 0.0)).all()
    assert (hole.high > (0.05, 0.0)).all()


def test_a_hole_in_a_dome_goes_on_as_the_dome_does() -> None:
    """A hole of 12 cm in a cap of radius 1 m: a lid would be 1.8 mm low in its middle, the surface is within 0.5 mm."""
    dome = where(ball(1.0), middles(ball(1.0))[:, 2] > 0.9)
    fine = dome
    for _ in range(2):
        mesh = fine.triangles
        mid = [0.5 * (mesh[:, k] + mesh[:, (k + 1) % 3]) for k in range(3)]
        parts = [(mesh[:, 0], mid[0], mid[2]), (mid[0], mesh[:, 1], mid[1]), (mid[2], mid[1], mesh[:, 2]), tuple(mid)]
        points = np.concatenate([np.stack(part, axis=1) for part in parts]).reshape(-1, 3)
        points /= np.linalg.norm(points, axis=1, keepdims=True)
        fine = Mesh.of(points, np.arange(len(points)).reshape(-1, 3))
    found = mended(with_hole(fine, (0.0, 0.0), (0.12, 0.12)))
    assert len(found.holes) >= 1
    assert height_at(found.mesh, 0.0, 0.0) == pytest.approx(1.0, abs=5e-4)


def test_a_tub_stays_open() -> None:
    """Walls lead down to what is seen in it."""
    inner = turned(fine_box((-0.2, -0.15, 0.1), (0.2, 0.15, TOP)), np.ones(12 * 4**5, dtype=bool))
    inner = where(inner, middles(inner)[:, 2] < TOP - 1e-6)
    plan = np.abs(middles(BLOCK)[:, :2])
    outer = where(BLOCK, ~((plan < (0.2, 0.15)).all(axis=1) & (middles(BLOCK)[:, 2] > TOP - 1e-6)))
    found = mended(Mesh.concatenate([outer, inner]))
    assert not found.holes
    assert height_at(found.mesh, 0.0, 0.0) == pytest.approx(0.1)


def test_a_gap_between_cushions_stays_a_gap() -> None:
    """3 cm wide and 15 cm deep, with sides."""
    left, right = fine_box((-0.4, -0.3, 0.2), (-0.015, 0.3, TOP)), fine_box((0.015, -0.3, 0.2), (0.4, 0.3, TOP))
    base = fine_box((-0.4, -0.3, 0.0), (0.4, 0.3, 0.25))
    found = mended(Mesh.concatenate([left, right, base]))
    assert height_at(found.mesh, 0.0, 0.0) == pytest.approx(0.25, abs=1e-6)


def test_floating_scraps_are_left_out() -> None:
    """Those in the air and those inside; not what lies on the thing, nor its feet."""
    feet = [fine_box((x, -0.28, -0.1), (x + 0.04, -0.24, -0.02), 1) for x in (-0.38, 0.34)]
    on_it = scrap((0.1, 0.1, TOP + 0.002))
    thing = Mesh.concatenate([BLOCK, *feet, on_it])
    found = mended(Mesh.concatenate([thing, scrap((0.0, 0.0, TOP + 0.1)), scrap((-0.1, 0.0, 0.2))]))
    assert found.scraps == 2
    assert len(found.mesh.faces) == len(thing.faces)
    assert found.scrap_area == pytest.approx(2 * 4e-4 * np.hypot(1.0, 0.25))  # 2 x 2 cm, a corner 5 mm up


def test_patches_that_were_inside_out_are_turned() -> None:
    """So that what is seen from above looks up, and the sides outwards."""
    found = mended(turned(BLOCK, middles(BLOCK)[:, 0] > 0.1))
    way = middles(found.mesh) - BLOCK.bounds.mean(axis=0)
    assert found.turned == int((middles(BLOCK)[:, 0] > 0.1).sum())
    assert (np.einsum("ij,ij->i", way, found.mesh.face_normals) > 0.0).all()


def test_a_sheet_seen_from_above_looks_up() -> None:
    """Its sides cannot tell, as it looks out both ways."""
    sheet = where(BLOCK, middles(BLOCK)[:, 2] > TOP - 1e-6)
    found = mended(turned(sheet, np.ones(len(sheet.faces), dtype=bool)))
    assert (found.mesh.face_normals[:, 2] > 0.0).all()


@pytest.mark.parametrize("thickness", [0.005, 0.012, 0.02, 0.04])
@pytest.mark.parametrize("underside", [True, False])
def test_slats_with_gaps_between_them_stay_as_they_are(thickness: float, underside: bool) -> None:
    """Boxes with 3 cm between them on two beams, closed or not scanned from below: what lies between them was built."""
    slats = [fine_box((x, -0.4, TOP - thickness), (x + 0.05, 0.4, TOP), 2) for x in np.arange(10) * 0.08]
    beams = [fine_box((0.0, y, 0.0), (0.77, y + 0.05, TOP - thickness), 2) for y in (-0.38, 0.33)]
    bench = Mesh.concatenate([*slats, *beams])
    if not underside:
        bench = where(bench, normals(bench)[:, 2] > -0.5)
    found = mended(bench)
    assert not found.holes
    assert len(found.mesh.faces) == len(bench.faces)


def test_a_shelf_of_wires_keeps_its_openings() -> None:
    """Closed rods of 3 mm, 6 cm and 15 mm apart, one way over the other."""
    for apart in (0.06, 0.015):
        along = np.arange(-0.15, 0.151, apart)
        rods = [fine_box((x, -0.2, TOP), (x + 0.003, 0.2, TOP + 0.003), 1) for x in along]
        rods += [fine_box((-0.2, y, TOP - 0.003), (0.2, y + 0.003, TOP), 1) for y in along]
        assert not mended(Mesh.concatenate(rods)).holes


@pytest.mark.parametrize("below", [True, False])
def test_a_torn_sheet_is_closed(below: bool) -> None:
    """With one side only, over the floor or over nothing."""
    sheet = where(BLOCK, middles(BLOCK)[:, 2] > TOP - 1e-6)
    torn = with_hole(sheet, (0.05, 0.0), (0.16, 0.12))
    floor = where(BLOCK, middles(BLOCK)[:, 2] < 1e-6)
    found = mended(Mesh.concatenate([torn, floor]) if below else torn)
    assert len(found.holes) == 1
    assert height_at(found.mesh, 0.05, 0.0) == pytest.approx(TOP, abs=1e-4)


def upper_side(low: tuple[float, float], high: tuple[float, float], z: float) -> Mesh:
    """A level sheet."""
    return where(box := fine_box((*low, z - 0.01), (*high, z), 2), middles(box)[:, 2] > z - 1e-6)


def test_slats_seen_from_above_only_are_no_scraps() -> None:
    """Ten of 3 cm x 1 m between two large ends, each with less than a twentieth of all area."""
    slats = [upper_side((x, 0.0), (x + 0.029, 1.0), TOP) for x in np.arange(10) * 0.06]
    ends = [fine_box((-0.1, y, 0.0), (0.7, y + 0.05, 0.8), 3) for y in (-0.1, 1.05)]
    assert mended(Mesh.concatenate([*slats, *ends])).scraps == 0


def test_shelves_whose_posts_a_scan_lacks_are_no_scraps() -> None:
    """Boards of 30 x 9 cm, each at its own height; a scrap between them is one."""
    boards = [upper_side((0.0, 0.0), (0.3, 0.09), 0.1 + 0.3 * level) for level in range(6)]
    back = where(box := fine_box((-0.1, 0.15, 0.0), (0.5, 0.2, 1.9), 3), normals(box)[:, 2] < 0.5)
    found = mended(Mesh.concatenate([*boards, back, scrap((0.1, 0.04, 0.25))]))
    assert found.scraps == 1
    assert height_at(found.mesh, 0.15, 0.05) == pytest.approx(1.6)


def test_an_island_of_a_torn_top_is_no_scrap() -> None:
    """It lies level with the rest; the same a hand higher is one."""
    for rise, scraps in ((0.0, 0), (0.1, 1)):
        island = upper_side((0.5, 0.0), (0.54, 0.04), TOP + rise)
        assert mended(Mesh.concatenate([BLOCK, island])).scraps == scraps


NOTHING = Mesh.of(np.zeros((0, 3)), np.zeros((0, 3)))
LINE = Mesh.of(np.array([[0, 0, 0], [0, 0, 1], [0, 0, 2.0]]), [[0, 1, 2], [0, 1, 1]])


@pytest.mark.parametrize("mesh", [NOTHING, LINE], ids=["nothing", "no_area"])
def test_what_has_no_area_is_left_alone(mesh: Mesh) -> None:
    """There is nothing to mend."""
    found = mended(mesh)
    assert not found.changed
    assert len(found.mesh.faces) == len(found.source) == len(mesh.faces)


def test_faces_without_area_are_no_harm() -> None:
    """A line that hangs over a block."""
    above = Mesh.of(LINE.vertices + np.array([0.0, 0.0, 1.0]), LINE.faces)
    assert not mended(Mesh.concatenate([BLOCK, above])).holes


@pytest.mark.parametrize("sides", [(0.5, 0.3), (30.0, 30.0), (100.0, 0.5), (3.0, 0.001)])
def test_there_is_a_limit_to_the_looks(sides: tuple[float, float]) -> None:
    """However large a thing is; small ones are looked at every 4 mm."""
    floor = fine_box((0.0, 0.0, 0.0), (*sides, 0.1), 1)
    seen = seen_from_above(Raycaster(floor), floor.bounds, look_spacing(floor.bounds))
    assert seen.height.size <= MOST_LOOKS
    assert seen.height.size > 0.8 * MOST_LOOKS or seen.cell == pytest.approx(0.004)


def test_a_small_hole_in_a_large_floor_is_found_where_it_matters() -> None:
    """Of 5 cm, in a floor of 30 m: looks all over it are 6 cm apart, those within a region of a metre 4 mm."""
    middle = with_hole(fine_box((-0.4, -0.4, -0.02), (0.4, 0.4, 0.0)), (0.13, 0.13), (0.05, 0.05))
    around = [
        fine_box(low, high, 1)
        for low, high in (
            ((-15.0, -15.0, -0.02), (-0.4, 15.0, 0.0)),
            ((0.4, -15.0, -0.02), (15.0, 15.0, 0.0)),
            ((-0.4, 0.4, -0.02), (0.4, 15.0, 0.0)),
            ((-0.4, -15.0, -0.02), (0.4, -0.4, 0.0)),
        )
    ]
    floor = Mesh.concatenate([middle, *around])
    near = np.array([[-0.4, -0.4], [0.6, 0.6]])
    assert not mended(floor).holes
    (hole,) = mended(floor, near).holes
    assert hole.sides == pytest.approx((0.05, 0.05), abs=0.03)


def test_a_rim_on_a_line_is_none() -> None:
    """Nothing says how steep the surface is across it, once both of its ends are found to be no rim."""
    height = np.full((9, 30), 5.0)
    height[3, 5:25], height[4, 4], height[4, 25] = 1.0, 0.95, 1.05
    pit = np.zeros(height.shape, dtype=bool)
    pit[4, 5:25] = True
    height[pit] = 0.0
    seen = HeightMap(np.zeros(2), 0.004, height, np.zeros(height.shape, dtype=np.int64))
    assert surface_across(seen, pit) is None
    height[5, 5:25] = 1.0
    assert surface_across(seen, pit) == pytest.approx(1.0, abs=0.01)


def test_windings_are_left_alone_where_nobody_needs_them() -> None:
    """What is inside out stays so."""
    torn = with_hole(BLOCK, (0.05, 0.0), (0.16, 0.12))
    over = turned(torn, np.ones(len(torn.faces), dtype=bool))
    assert mended(over).turned > 0
    assert mended(over, turn=False).turned == 0
