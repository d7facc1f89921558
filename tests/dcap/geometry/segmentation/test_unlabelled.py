"""Rooms without annotations, built of a few blocks whose statics are plain: which of them are one thing."""

from collections.abc import Sequence

import numpy as np
import pytest

from dcap.arrays import Array
from dcap.geometry.segmentation.faces import FaceTable
from dcap.geometry.segmentation.oversegmentation import convex_pieces
from dcap.geometry.segmentation.rooms.contacts import surfels_of
from dcap.geometry.segmentation.rooms.decomposition import decompose_room
from dcap.geometry.segmentation.rooms.pieces import carrying_pieces
from dcap.scene.types.mesh import Mesh
from dcap.synthetic.shapes import columns, joined, line, moved, rounded_box, sheet, turned, union

WIDTH, DEPTH, HEIGHT = 3.0, 2.6, 2.4
Place = tuple[float, float, float]


def tinted(mesh: Mesh, color: Sequence[int]) -> Mesh:
    """The mesh in one colour."""
    return Mesh.of(mesh.vertices, mesh.faces, color)


def block(size: Place, at: Place, color: Sequence[int] = (150, 110, 80)) -> Mesh:
    """A slightly rounded box; `at` is the middle of its underside [m]."""
    x, y, z = at
    return tinted(moved(rounded_box(size, 0.004, 0.03), x, y, z + size[2] / 2), color)


def shell() -> list[Mesh]:
    """Floor, ceiling and four walls that look inwards."""
    across = sheet(line(0, WIDTH, 0.1), line(0, DEPTH, 0.1), lambda u, v: columns(u, v, np.zeros_like(u)))
    front = sheet(line(0, WIDTH, 0.1), line(0, HEIGHT, 0.1), lambda u, v: columns(u, np.zeros_like(u), v))
    side = sheet(line(0, DEPTH, 0.1), line(0, HEIGHT, 0.1), lambda u, v: columns(np.zeros_like(u), u, v))
    sheets = []
    for plate, axis, far in ((across, 2, HEIGHT), (front, 1, DEPTH), (side, 0, WIDTH)):
        inward = plate if plate.face_normals[:, axis].sum() > 0 else flipped(plate)
        offset = np.zeros(3)
        offset[axis] = far
        sheets += [inward, Mesh.of(inward.vertices + offset, inward.faces[:, ::-1])]
    return [tinted(one, (235, 230, 220)) for one in sheets]


def flipped(mesh: Mesh) -> Mesh:
    """Seen from the other side."""
    return Mesh(mesh.vertices, mesh.faces[:, ::-1].copy(), mesh.colors)


def apart(blocks: Sequence[Mesh], seed: int = 0, degrees: float = 0.0) -> list[set[int]]:
    """Which blocks make up each thing that is found; faces in random order, the room turned about the vertical."""
    meshes = [*shell(), *blocks]
    owner = np.repeat(np.arange(len(meshes)), [len(m.faces) for m in meshes]) - 6
    whole = turned(joined(meshes), "z", degrees)
    order = np.random.default_rng(seed).permutation(len(owner))
    mesh = Mesh(whole.vertices, whole.faces[order], whole.colors)
    found = decompose_room(FaceTable.of(mesh), np.ones(len(order), dtype=bool), lambda unions, shapes: [])
    assert (owner[order][found.shell.any] < 0).all()
    assert found.shell.any.sum() == (owner < 0).sum()
    return [set(owner[order][faces].tolist()) for faces in found.things]


CABINET = block((0.8, 0.4, 0.7), (1.5, 1.3, 0.0))
ON_TOP = 0.7

CASES: dict[str, tuple[list[Mesh], list[set[int]]]] = {
    "what stands steadily on a larger surface is a thing of its own": (
        [CABINET, block((0.12, 0.12, 0.3), (1.4, 1.3, ON_TOP))],
        [{0}, {1}],
    ),
    "what covers its carrier is part of it": ([CABINET, block((0.82, 0.42, 0.03), (1.5, 1.3, ON_TOP))], [{0, 1}]),
    "a top is one with its legs": (
        [
            block((1.0, 0.6, 0.03), (1.5, 1.3, 0.7)),
            *(block((0.05, 0.05, 0.7), (1.5 + x, 1.3 + y, 0.0)) for x in (-0.45, 0.45) for y in (-0.25, 0.25)),
        ],
        [{0, 1, 2, 3, 4}],
    ),
    "a drawer's front is part of what it lies against": (
        [CABINET, block((0.76, 0.02, 0.3), (1.5, 1.09, 0.3))],
        [{0, 1}],
    ),
    "neighbours with a gap are two": ([CABINET, block((0.8, 0.4, 0.7), (2.35, 1.3, 0.0))], [{0}, {1}]),
    "what would tip over is part of what holds it": (
        [block((0.3, 0.3, 0.03), (1.0, 1.0, 0.0)), block((0.03, 0.03, 1.2), (1.0, 1.0, 0.03)),
         block((0.35, 0.35, 0.25), (1.0, 1.0, 1.23))],
        [{0, 1, 2}],
    ),
    "what hangs on a wall is a thing, and not the wall": (
        [CABINET, block((0.7, 0.03, 0.5), (1.2, 0.015, 1.2), (40, 60, 120))],
        [{0}, {1}],
    ),
    "a rug is not the floor": (
        [block((1.2, 0.8, 0.012), (1.5, 1.3, 0.0), (120, 30, 30)), block((0.5, 0.4, 0.5), (1.5, 1.3, 0.012))],
        [{0}, {1}],
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", CASES)
def test_statics_tell_what_is_one_thing(case: str) -> None:
    """Each rule on the plainest scene that shows it."""
    blocks, expected = CASES[case]
    assert sorted(map(sorted, apart(blocks))) == sorted(map(sorted, expected))


def test_order_of_faces_and_heading_do_not_matter() -> None:
    """All cases that fit side by side, shuffled and turned."""
    blocks, expected = CASES["what stands steadily on a larger surface is a thing of its own"]
    for seed, degrees in ((1, 0.0), (2, 33.0), (3, 90.0)):
        assert sorted(map(sorted, apart(blocks, seed, degrees))) == sorted(map(sorted, expected))


def test_a_fused_surface_is_cut_in_its_grooves() -> None:
    """A small box fused with a large one below: every face of each on its own side, but for the rounded rim."""
    large, small = (rounded_box(size, 0.01, 0.01) for size in ((0.6, 0.5, 0.3), (0.2, 0.2, 0.2)))
    fused = union([moved(large, z=0.15), moved(small, z=0.39)])
    table = FaceTable.of(fused)
    piece = convex_pieces(table, np.arange(len(fused.faces)))
    high = table.center[:, 2] > 0.31
    big = [int(np.bincount(piece[mask], table.area[mask]).argmax()) for mask in (high, ~high)]
    assert big[0] != big[1]
    right = np.where(high, piece == big[0], piece == big[1])
    assert table.area[right].sum() > 0.97 * table.area.sum()


def terrain(height: Array) -> Mesh:
    """A sheet of 1.6 x 0.6 m whose height runs along x as given."""
    xs = np.linspace(0.0, 1.6, 81)
    made = sheet(line(0, 1.6, 0.02), line(0, 0.6, 0.02), lambda u, v: columns(u, v, np.interp(u, xs, height)))
    return made if made.face_normals[:, 2].sum() > 0 else Mesh.of(made.vertices, made.faces[:, ::-1])


def levels_of(mesh: Mesh) -> list[float]:
    """Heights of the patches [m]."""
    table = FaceTable.of(mesh)
    pieces = carrying_pieces(surfels_of(table, np.arange(len(mesh.faces))), 0.0)
    return sorted(round(float(one), 2) for one in pieces.level)


def test_a_ramp_between_two_tops_parts_them() -> None:
    x = np.linspace(0.0, 1.6, 81)
    tops = 0.6 + 0.2 * np.clip((x - 0.6) / 0.5, 0.0, 1.0)
    assert levels_of(terrain(tops)) == pytest.approx([0.6, 0.8], abs=0.05)


def test_a_slope_stays_one() -> None:
    assert len(levels_of(terrain(0.5 + 0.3 * np.linspace(0.0, 1.0, 81)))) == 1


def test_a_rough_top_stays_one() -> None:
    rough = 0.5 + 0.04 * np.sin(np.linspace(0.0, 20.0, 81))
    assert len(levels_of(terrain(rough))) == 1
