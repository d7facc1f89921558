"""Promises of the procedural shapes, objects and rooms."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from dcap.geometry.pieces import is_closed
from dcap.synthetic import shapes
from dcap.synthetic.dataset import in_metres
from dcap.synthetic.recipes import object_recipes, room_names, room_recipe
from dcap.synthetic.room import FurnishedRoom
from dcap.synthetic.rooms import BuiltRoom, build_room, furnish
from dcap.synthetic.shapes import volume
from dcap.synthetic.shell import shell

OBJECTS = object_recipes()


@pytest.fixture(scope="module")
def built() -> dict[str, BuiltRoom]:
    return {name: build_room(name, 0) for name in ("bedroom_01", "dining_01", "bathroom_01", "living_02")}


@pytest.fixture(scope="module")
def furnished() -> dict[str, FurnishedRoom]:
    return {name: furnish(room_recipe(name), 0) for name in room_names()}


@settings(max_examples=25, deadline=None)
@given(
    size=st.tuples(*[st.floats(0.05, 1.0)] * 3),
    share=st.floats(0.05, 0.49),
)
def test_rounded_box_is_closed_and_has_its_volume(size: tuple[float, float, float], share: float) -> None:
    """A rounded box is closed and holds the Minkowski sum of its core and a ball."""
    radius = share * min(size)
    mesh = shapes.rounded_box(size, radius, edge=0.02)
    a, b, c = (s - 2 * radius for s in size)
    exact = (
        a * b * c + 2 * radius * (a * b + b * c + c * a) + np.pi * radius**2 * (a + b + c) + 4 / 3 * np.pi * radius**3
    )
    assert is_closed(mesh)
    # A chord polygon with at least 4 segments a quarter... with one arc step the corner loses at most the part between
    # chord and arc, (pi - 2) / pi of the rounded share; the bound covers it.
    rounded = exact - a * b * c - 2 * radius * (a * b + b * c + c * a)
    assert exact - 0.37 * rounded <= volume(mesh) <= exact * (1 + 1e-9)
    np.testing.assert_allclose(np.ptp(mesh.vertices, axis=0), size, rtol=1e-9)


def test_union_volume_is_inclusion_exclusion() -> None:
    """|A u B| = |A| + |B| - |A n B| for two boxes that share half."""
    a = shapes.rounded_box((0.2, 0.1, 0.1), 1e-4, 0.05)
    b = shapes.moved(a, x=0.1)
    whole = shapes.union([a, b])
    assert is_closed(whole)
    # The rounding takes 1e-4 off the edges: less than 1e-4 of the volume; single precision inside the union likewise.
    assert volume(whole) == pytest.approx(0.3 * 0.1 * 0.1, rel=1e-3)


@pytest.mark.parametrize("name", OBJECTS)
def test_objects_are_closed_solids_of_plausible_density(name: str) -> None:
    """Every part is closed; mass over volume lies between that of down and that of iron; they stand on z = 0."""
    item = in_metres(OBJECTS[name])
    solids = [solid for part in item.parts for solid in part.solids]
    assert all(is_closed(solid) and volume(solid) > 0 for solid in solids)
    density = OBJECTS[name].mass / sum(volume(solid) for solid in solids)
    assert 15 < density < 7900
    assert abs(item.bounds[0, 2]) < 0.0015
    assert 500 < sum(len(solid.faces) for solid in solids) < 40_000


@pytest.mark.parametrize("name", room_names())
def test_furniture_is_made_of_closed_solids_within_the_walls(furnished: dict[str, FurnishedRoom], name: str) -> None:
    """Every solid is closed, nothing reaches below the floor or through a wall."""
    room = furnished[name]
    for item in [*shell(room).things, *(placed.thing for placed in room.things)]:
        assert all(is_closed(solid) and volume(solid) > 0 for part in item.parts for solid in part.solids), item.label
    for placed in room.things:
        low, high = placed.thing.bounds
        assert low[2] > -0.004, placed.thing.label
        # 1 cm: pictures are let into the wall, leaves of plants may touch it
        assert (low[:2] > -0.01).all(), placed.thing.label
        assert high[0] < room.width + 0.01, placed.thing.label
        assert high[1] < room.depth + 0.01, placed.thing.label


@pytest.mark.parametrize("name", room_names())
def test_nothing_floats(furnished: dict[str, FurnishedRoom], name: str) -> None:
    """Every solid stands on the floor, hangs on wall or ceiling, or touches another solid's box within 3 mm."""
    room = furnished[name]
    solids = [s for placed in room.things for part in placed.thing.parts for s in part.solids]
    bounds = np.array([solid.bounds for solid in solids])
    for index, (low, high) in enumerate(bounds):
        fixed = low[2] < 0.01 or high[2] > room.height - 0.01 or min(low[0], low[1]) < 0.08
        fixed = fixed or high[0] > room.width - 0.08 or high[1] > room.depth - 0.08
        others = np.delete(bounds, index, axis=0)
        touching = ((others[:, 0] < high + 0.003) & (others[:, 1] > low - 0.003)).all(axis=1)
        assert fixed or touching.any(), (name, index, low, high)


def test_boxes_contain_their_faces(built: dict[str, BuiltRoom]) -> None:
    """Every annotated box holds all faces that the truth gives to its instance."""
    for room in built.values():
        boxes = {label.id: label.box for label in room.record.labels if label.box is not None and label.id}
        for index, instance in enumerate(room.instance_ids):
            faces = room.record.mesh.faces[room.face_instance == index]
            assert len(faces), room.instance_labels[index]
            if instance in boxes:
                assert boxes[instance].contains(room.record.mesh.vertices[np.unique(faces)], margin=1e-9).all()


def test_same_seed_same_room_other_seed_other_noise() -> None:
    """A room is a function of its name and seed."""
    first, again, other = build_room("hall_01", 3), build_room("hall_01", 3), build_room("hall_01", 4)
    assert np.array_equal(first.record.mesh.vertices, again.record.mesh.vertices)
    assert np.array_equal(first.record.mesh.colors, again.record.mesh.colors)
    assert np.array_equal(first.face_instance, again.face_instance)
    assert first.instance_ids == again.instance_ids
    assert not np.array_equal(first.record.mesh.vertices[:100], other.record.mesh.vertices[:100])
