"""Convex collision shapes: hulls, decompositions, cuts, and room for what is touched."""

import numpy as np
import pytest
import trimesh

from dcap.geometry.pieces import is_closed
from dcap.geometry.solid.contact_pieces import TOLERANCE, overlap, with_room
from dcap.geometry.solid.convex_pieces import (
    OUTSIDE,
    around_vertices,
    bounds_a_solid,
    convex_hull,
    convex_pieces,
    outside,
    slab_hull,
    volume_of,
    without_box,
)
from dcap.scene.types.mesh import Mesh


def box(low: tuple[float, ...], high: tuple[float, ...]) -> Mesh:
    """A closed box."""
    mesh = trimesh.creation.box(bounds=[low, high])
    return Mesh.of(mesh.vertices, mesh.faces)


def trough() -> Mesh:
    """A block 20 x 10 x 10 cm with a slot 10 cm wide and 5 cm deep along y in its underside."""
    block = trimesh.creation.box(bounds=[(-0.1, -0.05, 0.0), (0.1, 0.05, 0.1)])
    slot = trimesh.creation.box(bounds=[(-0.05, -0.06, -0.01), (0.05, 0.06, 0.05)])
    mesh = block.difference(slot, engine="manifold").subdivide_to_size(0.02)
    return Mesh.of(mesh.vertices, mesh.faces)


def test_a_hull_is_closed_and_wound_outwards() -> None:
    """The hull of a box with points inside is the box."""
    rng = np.random.default_rng(0)
    points = np.concatenate([box((0, 0, 0), (1, 2, 3)).vertices, rng.uniform(0.1, 0.9, (50, 3))])
    hull = convex_hull(points)
    assert hull is not None
    assert is_closed(hull)
    assert len(hull.vertices) == 8
    assert volume_of(hull) == pytest.approx(6.0)


def test_what_has_no_extent_has_no_hull() -> None:
    """A line has none; a plane has none as points, and a thin one as a surface."""
    line, square = np.linspace([0, 0, 0], [1, 1, 1], 9), np.array([[0, 0, 0], [1, 0, 0], [1, 1, 0], [0, 1, 0.0]])
    assert convex_hull(line) is None
    assert convex_hull(square) is None
    thin = slab_hull(Mesh.of(square, [[0, 1, 2], [0, 2, 3]]))
    assert thin is not None
    assert thin.bounds[1, 2] == pytest.approx(0.0)
    assert slab_hull(Mesh.of(line[:3], [[0, 1, 2]])) is None


@pytest.mark.parametrize("low", [(-0.2, -0.2, -0.2), (0.5, 0.5, 0.5), (0.2, -1.0, 0.9)])
def test_a_piece_without_a_box(low: tuple[float, float, float]) -> None:
    """The cut pieces have the volume of the piece less that of its overlap with the box, and none reaches into it."""
    piece, start = box((0, 0, 0), (1, 1, 1)), np.array(low)
    end = start + 0.7
    pieces = without_box(piece, start, end)
    shared = np.clip(np.minimum(end, 1.0) - np.maximum(start, 0.0), 0.0, None).prod()
    assert sum(map(volume_of, pieces)) == pytest.approx(1.0 - shared)
    if shared > 0.0:
        inner = np.random.default_rng(1).uniform(np.maximum(start, 0.0), np.minimum(end, 1.0), (200, 3))
        assert min(float(outside(one, inner).min()) for one in pieces) > -1e-6


def test_a_box_elsewhere_leaves_a_piece_as_it_is() -> None:
    piece = box((0, 0, 0), (1, 1, 1))
    assert without_box(piece, np.full(3, 2.0), np.full(3, 3.0)) == [piece]
    assert without_box(piece, np.full(3, -1.0), np.full(3, 3.0)) == []


def test_a_convex_thing_is_one_piece() -> None:
    ball = trimesh.creation.icosphere(3, 0.1)
    pieces = convex_pieces(Mesh.of(ball.vertices, ball.faces))
    assert len(pieces) == 1
    assert volume_of(pieces[0]) == pytest.approx(ball.volume, rel=1e-6)


def test_a_slot_stays_open() -> None:
    """A block with a slot becomes pieces that cover it and leave most of the slot open, twice the same."""
    mesh = trough()
    pieces = around_vertices(convex_pieces(mesh), mesh)
    assert len(pieces) > 1
    away = np.stack([outside(one, mesh.vertices) for one in pieces]).min(axis=0)
    assert away.max() <= OUTSIDE
    solid = 0.2 * 0.1 * 0.1 - 0.1 * 0.1 * 0.05
    assert sum(map(volume_of, pieces)) < solid + 0.1 * 0.1 * 0.1 * 0.05  # a tenth of the slot, concavity being 0.05
    again = around_vertices(convex_pieces(mesh), mesh)
    assert all((a.vertices == b.vertices).all() for a, b in zip(pieces, again, strict=True))


def crossed() -> Mesh:
    """Two long blocks through each other: every edge has two faces, but faces cross."""
    return Mesh.concatenate([box((-0.5, -0.05, 0.0), (0.5, 0.05, 0.1)), box((-0.05, -0.5, 0.02), (0.05, 0.5, 0.12))])


@pytest.mark.parametrize(
    ("mesh", "solid"),
    [
        (box((0, 0, 0), (1, 1, 1)), True),
        (Mesh.concatenate([box((0, 0, 0), (1, 1, 1)), box((2, 0, 0), (3, 1, 1))]), True),
        (Mesh.concatenate([box((0, 0, 0), (1, 1, 1)), box((1, 1, 0), (2, 2, 1))]), False),  # one edge of four faces
        (crossed(), False),
        (box((0, 0, 0), (1, 1, 1)).submesh(np.arange(10)), False),
    ],
    ids=["box", "two apart", "two at an edge", "crossed", "open"],
)
def test_what_bounds_a_solid(mesh: Mesh, solid: bool) -> None:
    assert bounds_a_solid(mesh) is solid


def test_blocks_through_each_other_are_cut_as_the_solid_around_them() -> None:
    """The corner between the arms stays open, and fitted pieces reach no farther than the blocks."""
    pieces = around_vertices(convex_pieces(crossed()), crossed())
    assert len(pieces) > 1
    corner = np.array([[0.3, 0.3, 0.05]])
    assert min(float(outside(one, corner)[0]) for one in pieces) > 0.05
    low, high = np.min([one.bounds[0] for one in pieces], axis=0), np.max([one.bounds[1] for one in pieces], axis=0)
    assert low == pytest.approx([-0.5, -0.5, 0.0], abs=1e-6)
    assert high == pytest.approx([0.5, 0.5, 0.12], abs=1e-6)


def test_pieces_make_room_for_what_bulges_into_them() -> None:
    """The hull of a slotted block is split until a bump in its slot overlaps no piece, and the block stays covered."""
    mesh = trough()
    x, y = np.meshgrid(np.linspace(-0.04, 0.04, 33), np.linspace(-0.04, 0.04, 33))
    bump = np.stack([x, y, 0.03 - 8.0 * x**2], axis=-1).reshape(-1, 3)
    hull = convex_hull(mesh.vertices)
    assert hull is not None
    assert overlap(hull, bump)[0] > 0.01
    pieces = with_room([hull], mesh, bump)
    assert max(overlap(one, bump)[0] for one in pieces) <= TOLERANCE
    assert np.stack([outside(one, mesh.vertices) for one in pieces]).min(axis=0).max() <= 1e-6
    assert all(outside(hull, one.vertices).max() <= 1e-6 for one in pieces)
