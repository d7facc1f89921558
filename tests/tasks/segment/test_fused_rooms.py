"""A room that is one noisy surface: a sofa, a low table and a shelf are found in it though nothing parts them."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import pytest

from dcap.arrays import Array
from dcap.geometry.segmentation.faces import FaceTable
from dcap.geometry.segmentation.rooms.decomposition import DecomposedRoom, decompose_room
from dcap.geometry.segmentation.rooms.unions import RoughShape
from dcap.scene.types.mesh import Mesh
from dcap.synthetic.scan import scanned
from dcap.synthetic.shapes import columns, joined, line, moved, rounded_box, sheet
from tasks.segment.room_labels import likely_things, room_labels, rough_measures

SIZE = (4.0, 3.6, 2.4)


def block(low: tuple[float, float, float], high: tuple[float, float, float]) -> Mesh:
    """A box with rounded edges."""
    size = np.subtract(high, low)
    made = rounded_box((float(size[0]), float(size[1]), float(size[2])), 0.01, 0.03)
    made = moved(made, *(0.5 * np.add(low, high)).tolist())
    return Mesh.of(made.vertices, made.faces, (150, 110, 80))


def shell() -> list[Mesh]:
    """Floor and walls that look inwards."""
    w, d, h = SIZE
    floor = sheet(line(0, w, 0.1), line(0, d, 0.1), lambda u, v: columns(u, v, np.zeros_like(u)))
    front = sheet(line(0, w, 0.1), line(0, h, 0.1), lambda u, v: columns(u, np.zeros_like(u), v))
    side = sheet(line(0, d, 0.1), line(0, h, 0.1), lambda u, v: columns(np.zeros_like(u), u, v))
    found = [floor if floor.face_normals[:, 2].sum() > 0 else Mesh.of(floor.vertices, floor.faces[:, ::-1])]
    for plate, axis, far in ((front, 1, d), (side, 0, w)):
        inward = plate if plate.face_normals[:, axis].sum() > 0 else Mesh.of(plate.vertices, plate.faces[:, ::-1])
        found += [inward, Mesh.of(inward.vertices + far * np.eye(3)[axis], inward.faces[:, ::-1])]
    return [Mesh.of(one.vertices, one.faces, (235, 230, 220)) for one in found]


SOFA = [
    block((1.0, 0.02, 0.0), (2.9, 0.9, 0.42)),
    block((1.0, 0.02, 0.42), (2.9, 0.3, 0.85)),
    block((1.0, 0.02, 0.42), (1.2, 0.9, 0.62)),
    block((2.7, 0.02, 0.42), (2.9, 0.9, 0.62)),
]
TABLE = [block((1.4, 1.5, 0.36), (2.5, 2.1, 0.42)), *(
    block((x, y, 0.0), (x + 0.06, y + 0.06, 0.37)) for x in (1.42, 2.42) for y in (1.52, 2.02)
)]  # fmt: skip
SHELF = [block((0.02, 2.2, z), (0.32, 3.2, z + 0.03)) for z in (0.05, 0.45, 0.85, 1.25)] + [
    block((0.02, y, 0.0), (0.32, y + 0.03, 1.28)) for y in (2.17, 3.2)
]


def in_cells(mesh: Mesh, size: float) -> Mesh:
    """The same written cell by cell, as some scanners do: nothing hangs together across a cell's sides."""
    centers = mesh.vertices[mesh.faces].mean(axis=1)
    cells = np.unique(np.floor((centers - mesh.bounds[0]) / size).astype(int), axis=0, return_inverse=True)[1].ravel()
    written = []
    for cell in range(cells.max() + 1):
        one = mesh.submesh(np.flatnonzero(cells == cell))
        middle = one.bounds.mean(axis=0)
        written.append(Mesh(middle + 0.996 * (one.vertices - middle), one.faces, one.colors))
    return joined(written)


@pytest.fixture(
    scope="module", params=[0.0, pytest.param(1.5, marks=pytest.mark.long)], ids=["one surface", "cell by cell"]
)
def room(request: pytest.FixtureRequest) -> DecomposedRoom:
    """The room as it is taken apart."""
    mesh = scanned(joined([*shell(), *SOFA, *TABLE, *SHELF]))
    if request.param:
        mesh = in_cells(mesh, request.param)
    return decompose_room(FaceTable.of(mesh), np.ones(len(mesh.faces), dtype=bool), likely_things)


def bounds(parts: list[Mesh]) -> Array:
    """Of all parts, shape (2, 3)."""
    return joined(parts).bounds


@pytest.mark.slow
@pytest.mark.parametrize("parts", [SOFA, TABLE, SHELF], ids=["sofa", "table", "shelf"])
def test_a_fused_thing_is_found(room: DecomposedRoom, parts: list[Mesh]) -> None:
    """Its rough rectangle and height are those that it was made with, to a scan's voxels and missing feet."""
    truth = bounds(parts)
    size = sorted(np.ptp(truth, axis=0)[:2], reverse=True)
    middle = truth.mean(axis=0)[:2]
    assert room.fused
    near = [one for one, faces in zip(room.fused, room.things, strict=True) if one.likely and len(faces)]
    fitting = [
        one.shape for one in near
        if abs(one.shape.length - size[0]) < 0.2 * size[0] + 0.05
        and abs(one.shape.width - size[1]) < 0.25 * size[1] + 0.05
        and abs(one.shape.top - truth[1, 2]) < 0.08
    ]  # fmt: skip
    assert len(fitting) == 1, (middle, [(o.shape.length, o.shape.width, o.shape.top) for o in near])
    assert fitting[0].held_by == "floor"


Color = tuple[float, float, float]


def shape(length: float, width: float, top: float, level: float, color: Color | None = None) -> RoughShape:
    """A thing on the floor, far from walls."""
    return RoughShape(
        length=length, width=width, bottom=None, top=top, level_height=level, level_area=0.8 * length * width,
        buried=0.0, cut=0.0, levels=1, wall_gap=1.0, holder=-1, held_by="floor", color=color,
    )  # fmt: skip


def labels_of(found: Sequence[RoughShape]) -> tuple[str, ...]:
    """What may stand in a room of these things."""
    return room_labels([rough_measures(one) for one in found], [one.held_by for one in found])


def rim(color: Color) -> RoughShape:
    """What a scan sees of a tub: a rim, and little else that looks up."""
    return replace(shape(1.7, 0.8, 0.58, 0.56, color), level_area=0.28 * 1.7 * 0.8, wall_gap=0.02)


def test_a_tub_makes_a_bathroom_if_it_is_white() -> None:
    """The same rim in the brown of a wooden bed does not, nor is anything wet then."""
    assert "toilet" in labels_of([rim((0.93, 0.93, 0.92)), shape(0.36, 0.36, 0.45, 0.45)])
    assert "toilet" not in labels_of([rim((0.4, 0.28, 0.2)), shape(0.36, 0.36, 0.45, 0.45)])


def test_a_living_room_has_no_toilet() -> None:
    """A seat of 40 cm beside a sofa and a table is none; what may stand in any room stays."""
    said = labels_of([shape(1.9, 0.88, 0.85, 0.42), shape(1.1, 0.6, 0.42, 0.42), shape(0.4, 0.4, 0.45, 0.45)])
    assert "toilet" not in said
    assert {"sofa", "stool", "rug"} <= set(said)
