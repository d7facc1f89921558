"""Which points of a rigid surface count before a soft one: ridges and corners do, wide flat regions do not."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from scipy.spatial.transform import Rotation

from solver.contact import flatness
from solver.contact.flatness import flat_regions, joined_faces

CELL = 0.01


def superfluous(lab, body, degrees=0.0, cell=CELL, *, partner=None, did=False):
    """Which points of a body are, turned about x since its start, above a partner whose normals all point up: a slab
    that has points everywhere unless another is given."""
    partner = partner or slab(lab, edge=0.005)
    count = len(body.vertices)
    before = np.full(count, did)
    turn = Rotation.from_rotvec([np.radians(degrees), 0.0, 0.0]).as_matrix()
    up = np.tile([0.0, 0.0, 1.0], (count, 1))
    under = body.vertices * [1.0, 1.0, 0.0] + [0.0, 0.0, partner.vertices[:, 2].max()]
    regions = flat_regions(body, partner, CELL)
    return regions.superfluous(np.arange(count), turn, under, up, np.full(count, cell), before)


def slab(lab, edge):
    return lab.soft("slab", lab.Box(np.array([0.2, 0.2, 0.02])), [0, 0, 0], E=1e4, cell=CELL, edge=edge)


def cube(lab, edge=0.004):
    return lab.rigid("cube", lab.Box(np.array([0.1, 0.1, 0.1])), [0, 0, 0], edge=edge)


def test_a_flat_underside_needs_none_of_its_points(lab):
    """Not even those of its rim and its corners: the partner's own points end there."""
    body = cube(lab)
    low = body.vertices[:, 2] == body.vertices[:, 2].min()
    found = superfluous(lab, body)
    assert found[low].all()
    assert not found[~low].any()


def test_what_was_superfluous_stays_so_for_a_while(lab):
    """Between 25 and 45 degrees it depends on what was before: else a body would rock between the two."""
    body = cube(lab)
    for degrees, fresh, kept in ((20.0, True, True), (35.0, False, True), (50.0, False, False)):
        low = body.vertices[:, 2] == body.vertices[:, 2].min()
        inner = low & (np.abs(body.vertices[:, :2]) < 0.02).all(axis=1)
        assert superfluous(lab, body, degrees)[inner].all() == fresh
        assert superfluous(lab, body, degrees, did=True)[inner].all() == kept


def test_a_ridge_keeps_its_points(lab):
    """A cube on its edge: both faces beside it are inclined by 45 degrees."""
    body = cube(lab)
    ridge = (body.vertices[:, 1:] == body.vertices[:, 1:].min(axis=0)).all(axis=1)
    assert ridge.any()
    assert not superfluous(lab, body, 45.0)[ridge].any()


def test_what_is_smaller_than_a_cell_keeps_its_points(lab):
    """A face of half a cell, and a ball of half a cell, could slip between the partner's points."""
    small = lab.rigid("small", lab.Box(np.array([0.004, 0.1, 0.1])), [0, 0, 0], edge=0.002)
    assert not superfluous(lab, small).any()
    assert not superfluous(lab, lab.rigid("ball", lab.Capsule(0.005, 0.0), [0, 0, 0], edge=0.001, spacing=5e-4)).any()


@pytest.mark.slow
@pytest.mark.long
def test_a_large_ball_needs_no_point_at_its_bottom(lab):
    """It is flat over more than a cell; before cells as large as itself it is not."""
    body = lab.rigid("ball", lab.Capsule(0.1, 0.0), [0, 0, 0], edge=0.004)
    bottom = body.vertices[:, 2] < -0.0995
    assert superfluous(lab, body)[bottom].all()
    assert not superfluous(lab, body, cell=0.1).any()


def test_a_face_without_points_in_it_keeps_those_at_its_corners(lab):
    """A box of twelve triangles: nothing is known of the middle of its faces."""
    assert not superfluous(lab, cube(lab, edge=1.0)).any()


def test_a_partner_needs_points_between_its_nodes(lab):
    """Only where it has them may others be left out: of a slab with points only on its left, the left ones."""
    body = cube(lab)
    low = body.vertices[:, 2] == body.vertices[:, 2].min()
    inner = low & (np.abs(body.vertices[:, :2]) < 0.03).all(axis=1)
    left, right = (inner & (side * body.vertices[:, 0] > 0.012) for side in (-1.0, 1.0))
    assert left.any()
    assert right.any()
    coarse = slab(lab, edge=0.01)
    assert not superfluous(lab, body, partner=coarse).any()
    on_left = np.nonzero((coarse.vertices[coarse.faces][:, :, 0] < 0.0).any(axis=1))[0]
    vertices, faces = trimesh.remesh.subdivide(coarse.vertices, coarse.faces, on_left)
    found = superfluous(lab, body, partner=replace(coarse, vertices=vertices, faces=faces))
    assert found[left].all()
    assert not found[right].any()


def test_small_faces_are_looked_at_together(lab, monkeypatch):
    """Area, mean place and direction stay; a surface ten times as fine as its cells has the same flat regions."""
    body = cube(lab, edge=0.02)
    corner = body.vertices[body.faces]
    cross = np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0])
    area = 0.5 * np.linalg.norm(cross, axis=1)
    center, normal, total = joined_faces(corner.mean(axis=1), 0.5 * cross / area[:, None], area, 0.05)
    assert len(total) < 0.5 * len(area)
    assert total.sum() == pytest.approx(area.sum(), rel=1e-12)
    assert total @ center == pytest.approx(area @ corner.mean(axis=1), abs=1e-12)
    assert np.abs(normal).max(axis=1) == pytest.approx(np.ones(len(total)), abs=1e-12)  # no two sides become one
    body = lab.rigid("board", lab.Box(np.array([0.1, 0.1, 0.04])), [0, 0, 0], edge=0.004)
    partner = slab(lab, edge=0.005)
    together = flat_regions(body, partner, 0.04)
    monkeypatch.setattr(flatness, "GRAIN", 1e-6)
    apart = flat_regions(body, partner, 0.04)
    assert {0.0, 0.04, 0.08} == set(apart.radius.ravel())
    assert (together.radius == apart.radius).mean() > 0.97


def test_what_is_thin_keeps_its_points(lab):
    """A point of the partner that has sunk half through a sheet would come out on the other side; a board is thick
    enough, up to its rim."""
    sheet, board = (
        lab.rigid("plate", lab.Box(np.array([0.1, 0.1, thick])), [0, 0, 0], edge=0.004, spacing=5e-4)
        for thick in (0.002, 0.012)
    )
    assert not superfluous(lab, sheet).any()
    low = board.vertices[:, 2] == board.vertices[:, 2].min()
    at_corner = (np.abs(board.vertices[:, :2]) > 0.05 - CELL).all(axis=1)
    assert superfluous(lab, board)[low & ~at_corner].all()
