"""What the viewer draws, as plain arrays."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from dented_bed import DEPTH, RADIUS, TOP, scene_of, settled
from placed_ball import FRAMES, SLIDE, pushed, values
from rest_records import LAST
from scipy.spatial.transform import Rotation as Turn

from dcap.scene.types.mesh import Mesh, PaintedMesh
from dcap.scene.types.outcome import Infeasible, Reason
from dcap.scene.types.segmentation import Segmentation
from flows.place import PlaceConfig
from flows.view import looks, model
from flows.view.model import DEEP, LEVEL, heat_colors, inside_near, placement_view, room_pieces, scene_view

BED = (0, 0)
"""The first part of the first thing."""
MILLIMETRE = 1e-3
"""The dent is a fan of chords 15 mm long in a sphere of 100 mm: off by up to 0.3 mm, and normals turn along them."""


def test_the_dent_is_as_deep_as_the_drop_made_it() -> None:
    """At rest the base is DEPTH below its top under the ball, at the start nowhere, in between by the frame's share."""
    view = placement_view(values(), PlaceConfig())
    assert view.bending is not None
    assert len(view.time) == FRAMES
    depth = [TOP - view.bending.surface(frame, BED).mesh.vertices[:, 2].min() for frame in range(FRAMES)]
    shares = [(frame / (FRAMES - 1)) ** 2 for frame in range(FRAMES)]
    assert depth == pytest.approx([share * DEPTH for share in shares], abs=MILLIMETRE)


def test_the_dent_counts_inwards_as_negative() -> None:
    """Displacement along the outward normal is -DEPTH at the deepest point, which gives the span of the colours."""
    view = placement_view(values(), PlaceConfig())
    assert view.bending is not None
    height = view.bending.heights(FRAMES - 1, "bed")
    assert height.min() == pytest.approx(-DEPTH, abs=MILLIMETRE)
    assert view.span == pytest.approx(DEPTH, abs=MILLIMETRE)
    assert heat_colors(np.array([-view.span, 0.0]), view.span).tolist() == [list(DEEP), list(LEVEL)]


def test_every_face_of_the_scene_is_drawn_once() -> None:
    """Still pieces and the moving faces have together the area that the scene has, at the start."""
    view = placement_view(values(), PlaceConfig())
    assert view.bending is not None
    still = sum(area(one.surface.mesh.vertices, one.surface.mesh.faces) for one in view.pieces)
    bending = [view.bending.surface(0, one.bends) for one in view.pieces if one.bends is not None]
    moving = sum(area(surface.mesh.vertices, surface.mesh.faces) for surface in bending)
    assert moving > 0.0
    assert still + moving == pytest.approx(scene_of().mesh.face_areas.sum(), rel=1e-5)  # drawn in single precision


def test_a_rigid_object_moves_as_a_whole() -> None:
    """Its shape stays; its pose at the last frame is that of the settled body."""
    view = placement_view(values(), PlaceConfig())
    assert view.thing is not None
    assert not view.thing.deforms
    body, last = settled().bodies[0], view.thing.poses[FRAMES - 1]
    assert last[:3, 3] == pytest.approx(body.position)
    assert last[:3, :3] == pytest.approx(Turn.from_quat(body.quaternion, scalar_first=True).as_matrix())


def test_things_that_were_placed_before_move() -> None:
    """The crate has a pose at every frame, the last of which is where it was pushed; nothing else of the room has."""
    scene, rest = pushed()
    view = placement_view(replace(values(rest), scene=scene), PlaceConfig())
    moves = {one.instance: one.poses for one in view.pieces if one.poses is not None}
    assert list(moves) == ["crate"]
    assert moves["crate"][0] == pytest.approx(np.eye(4))
    assert moves["crate"][FRAMES - 1][:3, 3] == pytest.approx(SLIDE)


def test_without_frames_there_are_the_start_and_the_end() -> None:
    """A drop whose frames nobody kept shows two states."""
    view = placement_view(values(settled()), PlaceConfig())
    assert not view.whole
    assert len(view.time) == 2
    assert view.thing is not None
    assert view.thing.poses[0] == pytest.approx(np.eye(4))
    assert view.thing.poses[1][:3, 3] == pytest.approx(settled().bodies[0].position)


def test_frames_are_left_out_where_all_would_be_too_much(monkeypatch: pytest.MonkeyPatch) -> None:
    """The first and the last stay, and the page says so."""
    monkeypatch.setattr(model, "MOST_MOVING", 1)
    view = placement_view(values(), PlaceConfig())
    assert view.time.tolist() == pytest.approx([0.0, 0.3])
    assert any("2 of the 4 frames" in note for note in view.notes)


def test_a_large_scene_is_thinned_and_says_so(monkeypatch: pytest.MonkeyPatch) -> None:
    """No more faces than the limit are drawn away from the contact; every thing is still there."""
    before = placement_view(values(), PlaceConfig())
    fine = scene_of()
    for _ in range(4):
        fine = halved(fine)
    monkeypatch.setattr(looks, "MOST_FACES", 3000)
    assert len(fine.mesh.faces) > 3000
    view = placement_view(replace(values(), scene=fine), PlaceConfig())
    assert sum(len(one.surface.mesh.faces) for one in view.pieces) < len(fine.mesh.faces)
    assert {one.instance for one in view.pieces} == {one.instance for one in before.pieces}
    assert "are shown" in view.notes[0]
    assert view.span == pytest.approx(DEPTH, abs=MILLIMETRE)


def test_a_drop_without_rest_shows_where_it_ended() -> None:
    """The object has two poses: where it was let go, and the last state's."""
    why = Infeasible(Reason.LEFT_TARGET, "it fell off", replace(LAST, position=np.array([0.5, 0.0, -0.4])))
    view = placement_view(replace(values(), settled=None, infeasible=why), PlaceConfig())
    assert view.bending is None
    assert view.contact is None
    assert view.thing is not None
    assert view.thing.poses[1][:3, 3].tolist() == [0.5, 0.0, -0.4]


def test_a_scene_alone_has_its_pieces_and_a_camera_above_its_floor() -> None:
    """Nothing is placed: no object, no anchor."""
    view = scene_view(scene_of(), PlaceConfig())
    assert view.thing is None
    assert view.anchor is None
    assert view.view.position[2] > scene_of().mesh.bounds[0, 2]
    assert {one.instance for one in view.pieces} == {one.id for one in scene_of().instances}


def test_walls_are_seen_from_inside_alone() -> None:
    """Every face of a wall is wound towards the contact, the outer ones too."""
    view = placement_view(values(), PlaceConfig())
    target = np.array([0.0, 0.0, TOP])
    for one in view.pieces:
        if one.structure:
            corner = one.surface.mesh.vertices[one.surface.mesh.faces].astype(float)
            normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
            assert (np.einsum("ij,ij->i", normal, target - corner.mean(axis=1)) >= -1e-6).all()


def test_a_floor_is_whole_under_what_lies_on_it() -> None:
    """All level faces of the floor look up, where the contact is on the floor and at the wall, too."""
    target = np.array([2.999, 0.0, 0.0])
    scene, none = scene_of(), np.zeros(len(scene_of().mesh.faces), dtype=bool)
    pieces = list(room_pieces(scene, PaintedMesh(scene.mesh), none, inside_near(scene, target), {}))
    floor = next(one.surface.mesh for one in pieces if one.instance == "floor")
    corner = floor.vertices[floor.faces].astype(float)
    normal = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    level = np.abs(normal[:, 2]) > 0.0
    assert (normal[level, 2] > 0.0).all()
    assert inside_near(scene_of(), target)[0] < 2.8


def test_the_anchor_has_the_normal_of_the_surface_and_a_ray_down_to_it() -> None:
    """On a level bed the normal is up; the ray starts at the middle of the ball before the drop."""
    mark = placement_view(values(), PlaceConfig()).anchor
    assert mark is not None
    assert mark.normal == pytest.approx([0.0, 0.0, 1.0])
    assert mark.above == pytest.approx([0.0, 0.0, TOP + 0.01 + RADIUS])


def area(vertices: np.ndarray, faces: np.ndarray) -> float:
    """Of triangles [m^2]."""
    corner = vertices[faces].astype(float)
    return float(0.5 * np.linalg.norm(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), axis=1).sum())


def halved(scene: Segmentation) -> Segmentation:
    """Every face split into four."""
    vertices, faces = trimesh.remesh.subdivide(scene.mesh.vertices, scene.mesh.faces)
    return replace(
        scene, mesh=Mesh.of(vertices, faces), face_instance=np.repeat(scene.face_instance, 4),
        face_part=np.repeat(scene.face_part, 4),
    )  # fmt: skip
