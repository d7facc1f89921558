"""Laws of closing surfaces: the result is closed and oriented, encloses what it should, and moves nothing in sight."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from dcap.geometry.distance import MeshDistance
from dcap.geometry.pieces import is_closed, signed_volume
from dcap.geometry.solid.cleaning import cleaned, face_stacks, heights
from dcap.geometry.solid.closed import RepairLimits, simulation_ready, tidied
from dcap.geometry.solid.repair_log import RepairLog
from dcap.geometry.solid.soundness import agreement, moved, well_formed
from dcap.geometry.solid.support import ready_support
from dcap.scene.errors import GeometryError
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.scan import Method, RepairReport
from dcap.synthetic.dataset import build_object

ROUNDING = 2.5e-6  # vertices are welded to 1e-6, single precision of less than 2e-6 is not looked at again


def of(mesh: trimesh.Trimesh) -> Mesh:
    """Our mesh."""
    return Mesh.of(mesh.vertices, mesh.faces)


def box(size: tuple[float, float, float] = (0.4, 0.3, 0.2), at: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Mesh:
    """A closed box with faces of a few centimetres."""
    mesh = trimesh.creation.box(size).subdivide().subdivide().subdivide()
    return Mesh.of(mesh.vertices + np.array(at), mesh.faces)


def ball(radius: float = 0.1) -> Mesh:
    """A closed ball."""
    return of(trimesh.creation.icosphere(3, radius))


def sheet(count: int = 9, bump: float = 0.0, size: float = 0.4) -> Mesh:
    """An open sheet at z = 0, seen from above."""
    x, y = np.meshgrid(*[np.linspace(0.0, size, count)] * 2, indexing="ij")
    corner = np.arange(count * count).reshape(count, count)
    a, b, c, d = (corner[s].ravel() for s in (np.s_[:-1, :-1], np.s_[1:, :-1], np.s_[1:, 1:], np.s_[:-1, 1:]))
    z = bump * np.sin(7 * x) * np.cos(5 * y)
    return Mesh.of(
        np.stack([x, y, z], -1).reshape(-1, 3), np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    )


def tub(size: tuple[float, float, float] = (1.6, 0.7, 0.5)) -> Mesh:
    """A box without its top: walls of one layer, wound outwards."""
    mesh = box(size)
    return mesh.submesh(np.flatnonzero(mesh.triangles[:, :, 2].min(axis=1) < 0.4999 * size[2]))


def with_faces(mesh: Mesh, faces: np.ndarray) -> Mesh:
    """The same vertices with other faces."""
    return replace(mesh, faces=np.ascontiguousarray(faces, dtype=np.int32))


def assert_sound(mesh: Mesh, report: RepairReport) -> None:
    """Closed, outwards, nothing empty or double, inside beyond doubt; and the report says so."""
    assert is_closed(mesh)
    assert signed_volume(mesh.vertices, mesh.faces) > 0.0
    assert (heights(mesh) > 0.0).all()
    assert len(np.unique(face_stacks(mesh.faces)[0])) == len(mesh.faces)
    assert agreement(mesh) >= 0.999
    assert report.closed
    assert not report.problem
    assert report.volume == pytest.approx(signed_volume(mesh.vertices, mesh.faces), rel=1e-12)


@pytest.mark.parametrize("name", ["shoe", "toy_block"])
def test_a_whole_part_is_left_as_it_is(name: str) -> None:
    """Closed solids of the embedded objects that do not meet others keep their volume, and nothing moves."""
    for part in build_object(name).parts:
        for solid in part.solids:
            ready, report = simulation_ready(solid)
            assert_sound(ready, report)
            assert report.hausdorff < ROUNDING
            assert report.resolution == 0.0
            assert report.volume == pytest.approx(signed_volume(solid.vertices, solid.faces), rel=1e-9)


def damaged(mesh: Mesh, kind: str, rng: np.random.Generator) -> Mesh:
    """The mesh with one kind of damage that does not change its solid."""
    count, some = len(mesh.faces), rng.choice(len(mesh.faces), len(mesh.faces) // 10, replace=False)
    if kind == "duplicated":
        return with_faces(mesh, np.concatenate([mesh.faces, mesh.faces[some], mesh.faces[some[:3]][:, [1, 2, 0]]]))
    if kind == "doubled and turned":
        return with_faces(mesh, np.concatenate([mesh.faces, mesh.faces[some][:, ::-1]]))
    if kind == "flipped":
        faces = mesh.faces.copy()
        faces[some] = faces[some][:, ::-1]
        return with_faces(mesh, faces)
    if kind == "inside out":
        return with_faces(mesh, mesh.faces[:, ::-1])
    if kind == "torn":
        return Mesh.of(mesh.vertices[mesh.faces.ravel()], np.arange(3 * count).reshape(-1, 3))
    if kind == "shaken":  # torn, and each copy of a vertex rounded its own way
        points = mesh.vertices[mesh.faces.ravel()]
        return Mesh.of(points + rng.uniform(-1e-7, 1e-7, points.shape), np.arange(3 * count).reshape(-1, 3))
    if kind == "slivers":
        a, b, c = mesh.faces[some].T
        middle = len(mesh.vertices) + np.arange(len(some))
        grown = np.concatenate([mesh.vertices, 0.5 * (mesh.vertices[a] + mesh.vertices[b])])
        lines = np.concatenate([np.stack([a, middle, b], 1), np.stack([a, a, c], 1)])
        return Mesh.of(grown, np.concatenate([mesh.faces, lines]))
    if kind == "junctions":  # an edge split for one of its two faces only
        a, b, c = mesh.faces[some[0]]
        grown = np.concatenate([mesh.vertices, 0.5 * (mesh.vertices[[a]] + mesh.vertices[[b]])])
        new = len(mesh.vertices)
        return Mesh.of(grown, np.concatenate([np.delete(mesh.faces, some[0], axis=0), [[a, new, c], [new, b, c]]]))
    assert kind == "stray"
    low, high = mesh.bounds
    far = high + 0.1 * (high - low)
    crumb = Mesh.of(far + 1e-3 * np.array([[0, 0, 0], [1, 0, 0], [0, 1, 0]]), [[0, 1, 2]])
    return Mesh.concatenate([mesh, crumb])


DAMAGES = (
    "duplicated", "doubled and turned", "flipped", "inside out", "torn", "shaken", "slivers", "junctions", "stray",
)  # fmt: skip


@pytest.mark.slow
@settings(max_examples=10)
@given(st.sampled_from([box, ball]), st.lists(st.sampled_from(DAMAGES), max_size=4), st.integers(0, 99))
def test_damage_that_leaves_the_surface_whole_is_undone(shape: object, kinds: list[str], seed: int) -> None:
    """Whatever is done to its faces, the solid has its volume again, and nothing that was seen has moved."""
    assert callable(shape)
    whole = shape()
    rng = np.random.default_rng(seed)
    mesh = whole
    for kind in kinds:
        mesh = damaged(mesh, kind, rng)
    ready, report = simulation_ready(mesh)
    assert_sound(ready, report)
    # shaken vertices move by 1e-7 each: volume by less than 1e-7 times the area
    assert report.volume == pytest.approx(signed_volume(whole.vertices, whole.faces), rel=1e-5)
    assert moved(whole, ready)[0] < 1e-5
    assert report.resolution == 0.0


@settings(max_examples=3)
@given(st.integers(0, 99), st.integers(1, 4))
def test_small_missing_patches_are_closed(seed: int, patches: int) -> None:
    """A ball with small holes has its volume but for the segments cut off, and a box of flat sides exactly."""
    rng = np.random.default_rng(seed)
    for whole, share in ((box(), 1e-9), (ball(), 1e-3)):
        center = whole.triangles.mean(axis=1)
        gone = np.zeros(len(whole.faces), dtype=bool)
        for one in rng.choice(len(center), patches, replace=False):
            gone |= np.arange(len(center)) == one
        ready, report = simulation_ready(whole.submesh(np.flatnonzero(~gone)))
        assert_sound(ready, report)
        # a missing face is its own cap; where two meet at an edge, what is cut off is a tetrahedron on two faces
        assert report.volume == pytest.approx(signed_volume(whole.vertices, whole.faces), rel=share)
        assert any("capped" in sentence for sentence in report.repairs)
        assert report.hausdorff < ROUNDING


def test_two_boxes_that_overlap_become_their_union() -> None:
    """Volume of both less that of the overlap; faces inside are gone and do not count as moved."""
    both = Mesh.concatenate([box(), box(at=(0.3, 0.2, 0.1))])
    ready, report = simulation_ready(both)
    assert_sound(ready, report)
    assert report.volume == pytest.approx(2 * 0.4 * 0.3 * 0.2 - 0.1 * 0.1 * 0.1, rel=1e-6)
    assert not MeshDistance(ready).unsigned(np.array([[0.19, 0.149, 0.05]]))[0] < 0.0099
    assert report.hausdorff < 1e-5


def test_two_boxes_with_a_common_wall_become_one() -> None:
    """A wall that two solids share, face by face, lies inside."""
    ready, report = simulation_ready(Mesh.concatenate([box(), box(at=(0.4, 0.0, 0.0))]))
    assert_sound(ready, report)
    assert report.volume == pytest.approx(2 * 0.4 * 0.3 * 0.2, rel=1e-9)


def test_a_hollow_stays_hollow() -> None:
    """An inner shell wound inside out is a hollow; wound outwards it is a part of the solid."""
    outer, inner = ball(0.1), ball(0.05)
    one, two = (signed_volume(m.vertices, m.faces) for m in (outer, inner))
    hollow, report = simulation_ready(Mesh.concatenate([outer, with_faces(inner, inner.faces[:, ::-1])]))
    assert_sound(hollow, report)
    assert report.volume == pytest.approx(one - two, rel=1e-6)
    _, report = simulation_ready(Mesh.concatenate([outer, inner]))
    assert report.volume == pytest.approx(one, rel=1e-6)


@pytest.mark.parametrize("bump", [0.0, 0.02])
@pytest.mark.parametrize("double", [False, True])
def test_a_thin_sheet_becomes_a_slab_below_it(bump: float, double: bool) -> None:
    """The sheet stays where it is; the other side is one thickness behind it, also if the sheet had two sides."""
    leaf, thickness = sheet(bump=bump), 0.01
    mesh = with_faces(leaf, np.concatenate([leaf.faces, leaf.faces[:, ::-1]])) if double else leaf
    ready, report = simulation_ready(mesh, allowed=RepairLimits(thickness=thickness))
    assert_sound(ready, report)
    assert report.hausdorff < ROUNDING
    # vertices are moved along their mean normals: tilted faces come out thinner by the cosine of half their angles
    assert report.volume == pytest.approx(thickness * float(leaf.face_areas.sum()), rel=1e-9 if bump == 0.0 else 0.02)
    if bump == 0.0:
        assert np.abs(ready.bounds[:, 2]).max() == pytest.approx(thickness)
        assert double or ready.bounds[0, 2] == pytest.approx(-thickness)  # of two equal sides either may be the front
    assert any("thickened to 10 mm" in sentence for sentence in report.repairs)


@pytest.mark.parametrize("floor", [None, -0.2])
def test_the_underside_of_a_board_does_not_come_out_of_its_top(floor: float | None) -> None:
    """A scanned table top of 27 mm has a face above and one below that do not hang together; a sheet becomes 30 mm."""
    top, below = sheet(17, 0.002), sheet(17, 0.002, 0.35)
    below = Mesh.of(below.vertices + np.array([0.025, 0.025, -0.027]), below.faces[:, ::-1])
    board = Mesh.concatenate([top, below])
    floors = None if floor is None else np.full(len(board.faces), floor)
    ready, report = simulation_ready(board, floor=floors)
    assert_sound(ready, report)
    assert report.hausdorff < ROUNDING
    assert ready.bounds[1, 2] == pytest.approx(top.bounds[1, 2], abs=ROUNDING)


def test_a_support_seen_from_above_is_solid_down_to_its_floor() -> None:
    """Area in plan times height, with the sheet itself where it was and a hole in it closed."""
    top = sheet(17, 0.01)
    middle = np.linalg.norm(top.triangles.mean(axis=1)[:, :2] - 0.2, axis=1)
    pricked = top.submesh(np.flatnonzero(middle > 0.03))
    ready, report = simulation_ready(pricked, floor=np.full(len(pricked.faces), -0.3))
    assert_sound(ready, report)
    under = 0.5 * top.face_normals[:, 2] * (top.triangles[:, :, 2].mean(axis=1) + 0.3)
    # the cap over the hole is flat where the sheet is not: less than the hole's area times the bump
    assert report.volume == pytest.approx(float(under.sum()), abs=np.pi * 0.05**2 * 0.01)
    assert ready.bounds[0, 2] == pytest.approx(-0.3)
    assert report.hausdorff < ROUNDING
    assert any("extruded" in sentence for sentence in report.repairs)


def test_a_leg_open_at_both_ends_is_not_hollow() -> None:
    """Both ends are closed: a tube seen from outside only is a bar."""
    bar = of(trimesh.creation.cylinder(0.05, 0.6, sections=40))
    tube = bar.submesh(np.flatnonzero(np.abs(bar.face_normals[:, 2]) < 1e-9))
    for floor in (None, np.full(len(tube.faces), -0.3)):
        ready, report = simulation_ready(tube, floor=floor)
        assert_sound(ready, report)
        # on a floor the lower end is continued by a millimetre, so that walls have a height
        assert report.volume == pytest.approx(
            signed_volume(bar.vertices, bar.faces), rel=1e-9 if floor is None else 2e-3
        )


@pytest.mark.slow
def test_what_passes_through_itself_is_meshed_again() -> None:
    """A bent tube through itself is no solid as it is; its remesh is closed and near, and says so."""
    angle = np.linspace(0.0, 2.0 * np.pi, 41)[:-1]
    path = np.stack([0.2 * np.sin(angle), 0.1 * np.sin(2 * angle), np.zeros(40)], axis=1)
    around = np.linspace(0.0, 2.0 * np.pi, 17)[:-1]
    way = np.roll(path, -1, 0) - np.roll(path, 1, 0)
    side = np.cross(way, [0, 0, 1]) / np.linalg.norm(way, axis=1, keepdims=True)
    ring = path[:, None] + 0.03 * (
        np.cos(around)[None, :, None] * side[:, None] + np.sin(around)[None, :, None] * np.array([0, 0, 1.0])
    )
    i, j = (n.ravel() for n in np.meshgrid(np.arange(40), np.arange(16), indexing="ij"))
    a, b, c, d = i * 16 + j, (i + 1) % 40 * 16 + j, (i + 1) % 40 * 16 + (j + 1) % 16, i * 16 + (j + 1) % 16
    eight = Mesh.of(ring.reshape(-1, 3), np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)]))
    ready, report = simulation_ready(eight)
    assert_sound(ready, report)
    assert report.resolution == pytest.approx(2e-3)
    assert report.hausdorff < report.resolution
    assert any("remeshed" in sentence for sentence in report.repairs)


def test_what_has_no_area_is_refused() -> None:
    """Nothing can be made of lines, and the error says how many there were."""
    with pytest.raises(GeometryError, match="none of 1 faces has an area"):
        simulation_ready(Mesh.of([[0, 0, 0], [1, 0, 0], [2, 0, 0]], [[0, 1, 2]]))


def test_same_input_same_bytes() -> None:
    """Two repairs of one mesh are equal to the last bit."""
    mesh = damaged(damaged(box(), "flipped", np.random.default_rng(3)), "torn", np.random.default_rng(4))
    (one, first), (two, second) = simulation_ready(mesh), simulation_ready(mesh)
    assert first == second
    assert one.vertices.tobytes() == two.vertices.tobytes()
    assert one.faces.tobytes() == two.faces.tobytes()


def test_repairs_are_counted() -> None:
    """What was dropped, turned and welded is told with its number."""
    mesh, log = damaged(box(), "duplicated", np.random.default_rng(0)), RepairLog()
    extra = len(mesh.faces) - len(box().faces)
    assert len(cleaned(mesh, log).faces) == len(box().faces)
    assert log.sentences() == (f"{extra} duplicate faces dropped",)


def test_a_moved_surface_is_measured() -> None:
    """A ball that has shrunk by 1 mm is 1 mm away everywhere, up to its facets."""
    most, mean, _ = moved(ball(0.1), ball(0.099))
    assert most == pytest.approx(1e-3, rel=0.02)
    assert mean == pytest.approx(1e-3, rel=0.02)
    assert well_formed(ball())


def test_what_cannot_be_seen_does_not_thin_the_mean() -> None:
    """A ball around another has shrunk by 1 mm: that is the mean, although the hidden ball has not moved."""
    inner = ball(0.09)
    given, solid = (Mesh.concatenate([one, inner]) for one in (ball(0.1), ball(0.099)))
    assert moved(given, solid)[1] == pytest.approx(1e-3, rel=0.02)


def test_only_places_within_the_box_count() -> None:
    """Of two boxes one has shrunk: that is seen in the box around it, not around the other, nor where nothing is."""
    still = box((0.1, 0.1, 0.1), (1.0, 0.0, 0.0))
    given, solid = (Mesh.concatenate([one, still]) for one in (box((0.1, 0.1, 0.1)), box((0.1, 0.1, 0.098))))
    around = np.array([[-0.06, -0.06, -0.06], [0.06, 0.06, 0.06]])
    assert moved(given, solid, within=around)[0] == pytest.approx(1e-3, rel=0.02)
    assert moved(given, solid, within=around + np.array([1.0, 0.0, 0.0]))[0] < ROUNDING
    assert moved(given, solid, within=around + np.array([0.0, 2.0, 0.0])) == (0.0, 0.0, 0.0)


def test_the_underside_of_a_layer_on_a_support_is_not_seen() -> None:
    """Nobody looks into a support from below; in a thing without a floor the layer is in sight."""
    block = box((0.4, 0.3, 0.2))
    shell = block.submesh(np.flatnonzero(block.face_normals[:, 2] > -1e-9))
    leaf = sheet(size=0.2)
    layer = Mesh.of(leaf.vertices + np.array([-0.1, -0.1, -0.06]), leaf.faces[:, ::-1])
    mesh = Mesh.concatenate([shell, layer])
    assert tidied(mesh, np.full(len(mesh.faces), -0.1), RepairLog()).moved(block)[0] < ROUNDING
    assert tidied(mesh, None, RepairLog()).moved(block)[0] == pytest.approx(0.04, abs=1e-3)


def test_a_support_that_keeps_what_the_object_can_reach_is_kept() -> None:
    """The faces and their shadows stay the solid while what they hide is out of reach; the report names the box."""
    upright, leaf = box((0.4, 0.3, 0.2)), sheet(size=0.2)
    down = Mesh.of(leaf.vertices + np.array([0.6, 0.0, 0.0]), leaf.faces[:, ::-1])  # an underside without a top
    mesh = Mesh.concatenate([upright, down])
    near = np.array([[-0.3, -0.3, -0.2], [0.3, 0.3, 0.3]])
    for region, kept in ((near, True), (near + np.array([0.6, 0.0, 0.0]), False)):
        _, report = ready_support(mesh, np.full(len(mesh.faces), -0.1), region, 0.25)
        assert report.region == tuple(region.ravel())
        assert report.closed
        assert not report.problem
        assert (report.repairs == ("faces kept as given, inside and outside decided by the winding number",)) == kept


@pytest.mark.parametrize("inwards", [pytest.param(False, marks=pytest.mark.long), True])
def test_an_open_tub_is_not_filled_to_the_brim(inwards: bool) -> None:
    """However its walls of one layer are wound: the middle is outside, and the report says what is wrong."""
    open_tub = tub()
    mesh = with_faces(open_tub, open_tub.faces[:, ::-1]) if inwards else open_tub
    floor, region = np.full(len(mesh.faces), -0.25), np.array([[-1.0, -1.0, -0.4], [1.0, 1.0, 0.6]])
    distance, report = ready_support(mesh, floor, region, 0.25)
    assert distance(np.array([[0.0, 0.0, 0.0], [0.5, 0.2, -0.1]])).min() > 0.1
    assert report.method is Method.WINDING
    assert report.problem == "its faces enclose nothing"
    _, whole = simulation_ready(mesh, floor=floor, allowed=RepairLimits(opening=0.5))
    assert "opening of 4.6 m around, seen from above, is filled" in whole.problem


def test_an_opening_that_is_small_covered_or_out_of_reach_may_be_filled() -> None:
    """A cup is closed like any hole in a support, and so is a tub under a board or where the object does not come."""
    for mesh, region in (
        (tub((0.05, 0.05, 0.1)), None),
        (Mesh.concatenate([tub(), box((1.7, 0.8, 0.02), (0.0, 0.0, 0.27))]), None),
        (tub(), np.array([[0.4, 0.5, -0.4], [1.0, 1.0, 0.6]])),
    ):
        given = tidied(mesh, np.full(len(mesh.faces), mesh.bounds[0, 2]), RepairLog(), region)
        assert (
            given.filled(MeshDistance(of(trimesh.convex.convex_hull(mesh.vertices))), RepairLimits(opening=0.25)) == 0.0
        )
    everywhere = tidied(tub(), np.full(len(tub().faces), -0.25), RepairLog())
    assert everywhere.filled(MeshDistance(box((1.6, 0.7, 0.5))), RepairLimits(opening=0.5)) == pytest.approx(4.6)
    assert everywhere.filled(MeshDistance(box((1.6, 0.7, 0.1))), RepairLimits(opening=0.5)) == pytest.approx(4.6)
    assert everywhere.filled(MeshDistance(box((1.6, 0.7, 0.1), (0.0, 0.0, -0.2))), RepairLimits(opening=0.5)) == 0.0
