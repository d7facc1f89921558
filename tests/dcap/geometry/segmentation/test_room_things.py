"""Laws of measuring and joining the things of a room that were told apart by statics."""

from collections.abc import Sequence
from itertools import pairwise

import numpy as np
import pytest

from dcap.geometry.primitives import Box
from dcap.geometry.segmentation.faces import FaceTable
from dcap.geometry.segmentation.rooms.composites import CompositeThing, composites
from dcap.geometry.segmentation.rooms.decomposition import DecomposedRoom
from dcap.geometry.segmentation.rooms.shell import Levels, ScannedShell
from dcap.geometry.segmentation.rooms.traits import CEILING, FLOOR, WALL, Traits, describe_things, thing_segments
from dcap.scene.types.mesh import Mesh
from dcap.synthetic.shapes import joined, moved

Corner = tuple[float, float, float]


def block(low: Corner, high: Corner) -> Mesh:
    """A closed box."""
    a, b = np.array(low), np.array(high)
    return moved(Box(b - a).surface(0.1), *(0.5 * (a + b)))


def table(x: float = 0.0) -> Mesh:
    """1 x 0.6 x 0.7 m on four legs."""
    legs = [block((x + i, j, 0.0), (x + i + 0.05, j + 0.05, 0.66)) for i in (0.0, 0.95) for j in (0.0, 0.55)]
    return joined([block((x, 0.0, 0.66), (x + 1.0, 0.6, 0.70)), *legs])


def measured(meshes: Sequence[Mesh]) -> tuple[FaceTable, DecomposedRoom]:
    """Things in a room whose floor is at 0, its ceiling at 2.5 m and its one wall at y = 3 m."""
    face_table = FaceTable.of(joined(list(meshes)))
    ends = np.cumsum([0, *(len(mesh.faces) for mesh in meshes)])
    none = np.zeros(len(face_table.area), dtype=bool)
    shell = ScannedShell(none, none, np.where(none, 0, -1), np.array([[0.0, -1.0, 0.0, -3.0]]), Levels(0.0, 2.5))
    return face_table, DecomposedRoom(shell, tuple(np.arange(a, b) for a, b in pairwise(ends)))


def traits(*meshes: Mesh) -> tuple[Traits, ...]:
    face_table, things = measured(meshes)
    return describe_things(face_table, things, thing_segments(face_table, things))


def found(labels: Sequence[str], *meshes: Mesh) -> list[CompositeThing]:
    face_table, things = measured(meshes)
    segments = thing_segments(face_table, things)
    return composites(labels, describe_things(face_table, things, segments), segments)


def members(labels: Sequence[str], *meshes: Mesh) -> list[tuple[str, tuple[int, ...]]]:
    return [(whole.label, whole.members) for whole in found(labels, *meshes)]


def test_what_holds_a_thing() -> None:
    """A cup stands on the table, the table on the floor, a picture hangs at the wall, a lamp at the ceiling."""
    cup = block((0.4, 0.2, 0.70), (0.5, 0.3, 0.80))
    picture, lamp = block((0.0, 2.96, 1.2), (0.5, 2.99, 1.6)), block((0.0, 0.0, 2.3), (0.3, 0.3, 2.5))
    desk, mug, frame, light = traits(table(), cup, picture, lamp)
    assert (desk.held_by, desk.holder, desk.carries) == (FLOOR, -1, 1)
    assert (mug.held_by, mug.holder, mug.carries) == ("", 0, 0)
    assert (frame.held_by, light.held_by) == (WALL, CEILING)
    assert frame.wall_gap == pytest.approx(0.01, abs=1e-6)


BED = block((0.0, 0.0, 0.0), (1.6, 2.0, 0.5))
PILLOW = block((0.1, 1.5, 0.5), (0.7, 1.9, 0.62))
HEADBOARD = block((0.0, 2.005, 0.0), (1.6, 2.05, 1.0))


def test_bedding_and_headboard_belong_to_the_bed() -> None:
    """What lies on a bed and is bedding, and the headboard that touches it, are the bed; a lamp beside it is not."""
    lamp = block((2.0, 1.5, 0.0), (2.2, 1.7, 0.4))
    labels = ["bed", "pillow", "headboard", "table lamp"]
    assert members(labels, BED, PILLOW, HEADBOARD, lamp) == [("bed", (0, 1, 2)), ("table lamp", (3,))]


def test_the_whole_may_be_called_otherwise_with_its_part() -> None:
    """A cabinet with a basin on it is a basin cabinet."""
    cabinet, basin = block((0, 0, 0), (1.0, 0.5, 0.8)), block((0.3, 0.05, 0.8), (0.7, 0.45, 0.93))
    assert members(["cabinet", "basin"], cabinet, basin) == [("basin cabinet", (0, 1))]


def test_a_leg_is_part_of_what_it_holds_up() -> None:
    """A leg goes with what stands on it, not with the rug below; alone it is a thing without a name."""
    rug, leg = block((-1, -1, 0.0), (1, 1, 0.01)), block((0.0, 0.0, 0.01), (0.05, 0.05, 0.30))
    seat = block((-0.2, -0.2, 0.30), (0.25, 0.25, 0.40))
    assert members(["rug", "leg", "stool"], rug, leg, seat) == [("rug", (0,)), ("stool", (1, 2))]
    assert members(["rug", "leg"], rug, leg) == [("rug", (0,)), ("", (1,))]


def test_what_is_in_a_box_belongs_to_it() -> None:
    """Toys inside a box are part of it, one beside it is not."""
    walls = [block((x, 0.0, 0.0), (x + 0.02, 0.4, 0.3)) for x in (0.0, 0.48)]
    walls += [block((0.0, y, 0.0), (0.5, y + 0.02, 0.3)) for y in (-0.02, 0.4)]
    inside, beside = block((0.2, 0.1, 0.01), (0.3, 0.2, 0.11)), block((0.8, 0.1, 0.0), (0.9, 0.2, 0.1))
    assert members(["box", "leg", "toy"], joined(walls), inside, beside) == [("box", (0, 1)), ("toy", (2,))]
