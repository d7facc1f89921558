"""Repairs keep what they must keep: area, closedness, volume, moments."""

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from dcap.geometry.distance import MeshDistance
from dcap.geometry.pieces import boundary_edges, hole_loops, is_closed
from dcap.geometry.solid.cleaning import split_at_junctions
from dcap.geometry.solid.repair import (
    FILL_SAMPLES,
    RELIEF,
    longest_near,
    mass_properties,
    outer_faces,
    simplified,
    small_holes_capped,
    solid_under,
    subdivide_near,
    volume,
)
from dcap.scene.errors import GeometryError
from dcap.scene.types.mesh import Mesh


def of(mesh: trimesh.Trimesh) -> Mesh:
    """Our mesh."""
    return Mesh.of(mesh.vertices, mesh.faces)


def box(size: tuple[float, float, float] = (0.4, 0.3, 0.2)) -> Mesh:
    """A closed box around the origin."""
    return of(trimesh.creation.box(size))


def faces_up(mesh: Mesh) -> Mesh:
    """Only what is seen from straight above."""
    return mesh.submesh(np.flatnonzero(mesh.face_normals[:, 2] > 1e-9))


def torn(mesh: Mesh) -> Mesh:
    """The same triangles without shared vertices, as at texture seams."""
    count = 3 * len(mesh.faces)
    return Mesh.of(mesh.vertices[mesh.faces.ravel()], np.arange(count).reshape(-1, 3))


def test_boundary_is_found_with_and_without_shared_vertices() -> None:
    """A closed box has no boundary; without its top it has the four edges around it, torn or not."""
    for mesh in (box(), torn(box())):
        assert is_closed(mesh)
        low = mesh.submesh(np.flatnonzero(mesh.triangles[:, :, 2].min(axis=1) < 0.0))
        edge, face = boundary_edges(low)
        assert len(edge) == 4
        assert np.allclose(low.vertices[edge][..., 2], 0.1)
        assert (low.triangles[face][:, :, 2].max(axis=1) > 0.09).all()
        assert [len(loop) for loop in hole_loops(low)] == [4]


def test_only_small_holes_are_capped() -> None:
    """A missing triangle is closed again, exactly in area for a flat one; a missing side is left open."""
    mesh = subdivide_near(box(), box().bounds, 0.05)
    whole = float(mesh.face_areas.sum())
    pricked = mesh.submesh(np.arange(1, len(mesh.faces)))
    capped = small_holes_capped(pricked, 0.3)
    assert is_closed(capped)
    assert abs(capped.face_areas.sum() - whole) < 1e-12
    open_ = mesh.submesh(np.flatnonzero(mesh.triangles[:, :, 2].min(axis=1) < 0.1))
    assert not is_closed(small_holes_capped(open_, 0.3))


@settings(max_examples=20, deadline=None)
@given(st.floats(0.05, 0.3), st.integers(0, 3))
def test_what_lies_under_a_sheet_is_its_area_times_its_height(depth: float, bumps: int) -> None:
    """Solid under z = f(x, y) has the volume of the integral of f over its bottom, whatever the sheet's shape."""
    side = np.linspace(0.0, 0.4, 9)
    x, y = np.meshgrid(side, side, indexing="ij")
    z = 0.03 * np.sin(bumps * 7 * x) * np.cos(bumps * 5 * y)
    corner = np.arange(81).reshape(9, 9)
    a, b, c, d = (corner[s].ravel() for s in (np.s_[:-1, :-1], np.s_[1:, :-1], np.s_[1:, 1:], np.s_[:-1, 1:]))
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    sheet = Mesh.of(np.stack([x, y, z], -1).reshape(-1, 3), faces)
    solid = solid_under(sheet, np.full(len(faces), -depth))
    plan = 0.5 * sheet.face_normals[:, 2]
    height = sheet.triangles[:, :, 2].mean(axis=1)
    expected = float((plan * (height + depth - RELIEF * (height - z.min()))).sum())
    assert is_closed(solid)
    assert abs(volume(solid) - expected) < 1e-12


def test_a_closed_mesh_keeps_its_solid_over_a_deep_bottom() -> None:
    """What looks down takes away what lies under it: a floating box stays a box, and only its own faces are outer."""
    solid = solid_under(box(), np.full(12, -2.0))
    # the shadow of a closed mesh is a turned copy of it with a thousandth of its height
    assert abs(volume(solid) / volume(box()) - (1.0 - RELIEF)) < 1e-12
    inside = MeshDistance(solid).inside(np.array([[0, 0, 0.05], [0, 0, -0.5], [0, 0, 0.15]]))
    assert inside.tolist() == [True, False, False]
    assert len(outer_faces(solid)) == 12


def test_refining_keeps_area_and_stays_conforming() -> None:
    """Splitting faces changes no area, opens no crack even across torn seams, and meets the edge length in the
    region.
    """
    region = np.array([[-0.05, -0.05, 0.05], [0.05, 0.05, 0.15]])
    for mesh in (box(), torn(box())):
        fine = subdivide_near(mesh, region, 0.012)
        assert abs(fine.face_areas.sum() - mesh.face_areas.sum()) < 1e-12
        assert is_closed(fine)
        corner = fine.triangles
        near = ((corner.max(axis=1) >= region[0]) & (corner.min(axis=1) <= region[1])).all(axis=1)
        edges = np.linalg.norm(corner - np.roll(corner, -1, axis=1), axis=2)
        assert near.any()
        assert edges[near].max() <= 0.012 * (1 + 1e-9)
        assert edges.max() > 0.1  # far faces stay large


def test_a_budget_leaves_edges_longer_and_never_fails() -> None:
    """With any budget a mesh stays conforming and grows by no more faces than that; a larger budget makes no edge near
    the region longer, and edges are no longer than asked where the budget does."""
    region = np.array([[-0.05, -0.05, 0.05], [0.05, 0.05, 0.15]])
    longest = []
    for budget in (0, 100, 1000, 10_000):
        fine = subdivide_near(box(), region, 1e-4, budget)
        assert len(fine.faces) <= len(box().faces) + budget
        assert is_closed(fine)
        longest.append(longest_near(fine, region))
    assert longest == sorted(longest, reverse=True)
    # edges are at least halved while each halving costs at most four times the faces: 10,000 faces allow four of them
    assert longest[-1] <= longest[0] / 16.0
    enough = subdivide_near(box(), region, 0.012, 10_000)
    assert longest_near(enough, region) <= 0.012 * (1 + 1e-9)


def test_a_sheet_with_an_upright_edge_has_a_closed_solid() -> None:
    """The wall under an edge that runs straight down has no area, but without it nothing would be closed: an L of a
    level and an upright square, open on all sides, 0.1 m above its floor."""
    corner = [[0, 0, 0.2], [0.1, 0, 0.2], [0.1, 0.1, 0.2], [0, 0.1, 0.2], [0.1, 0, 0.1], [0.1, 0.1, 0.1]]
    sheet = Mesh.of(corner, [[0, 1, 2], [0, 2, 3], [1, 4, 5], [1, 5, 2]])
    solid = solid_under(sheet, np.zeros(4))
    assert is_closed(solid)
    # the level square's column less what its shadow's relief takes: under 2e-3 of the volume
    assert abs(volume(solid) / 2e-3 - 1.0) < 2e-3
    assert MeshDistance(solid).inside(np.array([[0.05, 0.05, 0.1], [0.15, 0.05, 0.1]])).tolist() == [True, False]
    assert (solid.face_areas[outer_faces(solid)] > 0.0).all()


def test_refining_interpolates_colours() -> None:
    """A new vertex in the middle of an edge has the mean colour of its ends."""
    mesh = Mesh.of([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]], [[0, 0, 0], [200, 100, 50], [0, 0, 0]])
    fine = subdivide_near(mesh, mesh.bounds, 0.8)
    middle = np.flatnonzero(np.linalg.norm(fine.vertices - [0.5, 0, 0], axis=1) < 1e-12)
    assert fine.colors[middle].tolist() == [[100, 50, 25]]


def test_mass_properties_of_a_box_are_exact() -> None:
    """m = rho a b c and I = m (b^2 + c^2) / 12 about any axis, at any place; winding does not matter."""
    size, density, place = np.array([0.4, 0.3, 0.2]), 700.0, np.array([2.0, -1.0, 0.5])
    mesh = Mesh.of(box().vertices + place, box().faces)
    turned = Mesh(mesh.vertices, mesh.faces[:, ::-1].copy(), mesh.colors)
    mass = density * np.prod(size)
    expected = mass / 12.0 * np.diag((size**2).sum() - size**2)
    for one in (mesh, turned):
        found, center, inertia = mass_properties(one, density)
        assert found == pytest.approx(mass, rel=1e-12)
        assert np.allclose(center, place, atol=1e-12)
        assert np.allclose(inertia, expected, rtol=1e-10, atol=1e-12)


@pytest.mark.slow
def test_mass_properties_of_an_open_sphere_come_from_its_filling() -> None:
    """A sphere with a hole weighs what the sphere weighs; the surface is smeared over one sample, 3 h / R relative
    at most.
    """
    radius = 0.1
    ball = of(trimesh.creation.icosphere(3, radius))
    open_ = ball.submesh(np.flatnonzero(ball.triangles[:, :, 2].min(axis=1) > -0.095))
    assert not is_closed(open_)
    found, center, inertia = mass_properties(open_, 1000.0)
    spacing = 2.0 * radius / FILL_SAMPLES
    exact = 1000.0 * 4.0 / 3.0 * np.pi * radius**3
    # the hole's cap is missing: a segment of height 5 mm and what the winding number makes of its rim
    segment = np.pi * 0.006**2 * (radius - 0.002) / (4.0 / 3.0 * np.pi * radius**3)
    assert abs(found / exact - 1.0) < 0.25 * 3.0 * spacing / radius + segment + 0.002
    assert np.linalg.norm(center) < 2e-3
    assert np.allclose(np.diag(inertia), 0.4 * found * radius**2, rtol=0.02)


def test_a_sheet_has_no_volume() -> None:
    """A single triangle encloses nothing, and the error says so."""
    with pytest.raises(GeometryError, match="a sheet, not a solid"):
        mass_properties(Mesh.of([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]), 1.0)


def test_a_sheet_with_two_sides_has_no_volume_either() -> None:
    """It is closed, and what it encloses is rounding: a leaf in space, its other side with vertices of its own."""
    x, y = np.meshgrid(np.linspace(0, 1, 9), np.linspace(0, 1, 9), indexing="ij")
    corner = np.arange(81).reshape(9, 9)
    a, b, c, d = (corner[k].ravel() for k in (np.s_[:-1, :-1], np.s_[1:, :-1], np.s_[1:, 1:], np.s_[:-1, 1:]))
    points = np.stack([x, y, 0.3 * x * y + 0.1 * x], axis=-1).reshape(-1, 3)
    leaf = Mesh.of(points, np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)]))
    both = Mesh.concatenate([leaf, Mesh.of(leaf.vertices, leaf.faces[:, ::-1])])
    assert is_closed(both)
    with pytest.raises(GeometryError, match="a sheet, not a solid"):
        mass_properties(both, 1.0)


def test_simplifying_keeps_the_shape() -> None:
    """A sphere with a tenth of its vertices keeps its volume within the sagitta of its edges; small meshes stay."""
    ball = of(trimesh.creation.icosphere(5, 0.1))
    small = simplified(ball, 1000)
    assert len(small.vertices) <= 1010
    edge = np.linalg.norm(small.triangles - np.roll(small.triangles, -1, axis=1), axis=2).max()
    # chords below the sphere by at most edge^2 / (6 R); volume follows the radius threefold
    assert abs(volume(small) / volume(ball) - 1.0) < 3.0 * edge**2 / (6.0 * 0.1**2)
    assert simplified(ball, 10**6) is ball


def test_a_face_that_is_only_a_line_of_its_own_edge_is_left_out():
    """Its third corner lies on its own open edge, so that nothing of it is left when that is split there."""
    vertices = np.array([[0, 0, 0], [1, 0, 0], [0.5, 1, 0], [0.5, -1, 0], [0.5, 0, 0]], dtype=float)
    faces = np.array([[0, 4, 1], [0, 1, 2], [1, 0, 3]], dtype=np.int32)
    mesh, count = split_at_junctions(Mesh.of(vertices, faces))
    assert count == 1
    assert mesh.faces.shape == (2, 3)
