"""Signed distances against closed forms."""

from typing import Any

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from dcap.geometry.distance import BAND, MeshDistance, lattice, sampled, sampler
from dcap.scene.errors import GeometryError
from dcap.scene.types.mesh import Mesh

SHIFT = np.array([3.1, -2.4, 0.7])  # a place in a room: single precision must not show


def of(mesh: Any) -> Mesh:
    """Our mesh, moved to a place in a room."""
    return Mesh.of(mesh.vertices + SHIFT, mesh.faces)


def cup(radius: float = 0.04, wall: float = 0.004, height: float = 0.09) -> trimesh.Trimesh:
    """A closed solid of revolution: a cylinder with a bore that is open at the top and has a floor as thick as its
    wall.
    """
    profile = np.array(
        [[0, 0], [radius, 0], [radius, height], [radius - wall, height], [radius - wall, wall], [0, wall]]
    )
    return trimesh.creation.revolve(profile, sections=64)


@settings(max_examples=25, deadline=None)
@given(st.tuples(*[st.floats(-0.3, 0.3)] * 3))
def test_distance_to_a_box_is_exact(point: tuple[float, float, float]) -> None:
    """The signed distance to a box has a closed form; ours differs by single precision only."""
    size = np.array([0.2, 0.3, 0.15])
    excess = np.abs(point) - 0.5 * size
    expected = np.linalg.norm(np.maximum(excess, 0.0)) + min(excess.max(), 0.0)
    if abs(expected) > 1e-5:  # on the surface itself the side is a matter of rounding
        found = MeshDistance(of(trimesh.creation.box(size)))(SHIFT + np.array([point]))[0]
        assert abs(found - expected) < 1e-6


def test_a_box_without_its_bottom_is_still_solid() -> None:
    """The winding number closes a hole: deep points of an open box are inside, points beside and above it outside."""
    box = trimesh.creation.box((0.4, 0.4, 0.2))
    mesh = of(box)
    mesh = mesh.submesh(np.flatnonzero(mesh.face_normals[:, 2] > -1e-9))
    inside = SHIFT + np.array([[0, 0, 0.05], [0.15, 0.15, -0.03], [-0.19, 0, 0.09]])
    outside = SHIFT + np.array([[0, 0, 0.11], [0.21, 0, 0], [0, 0, -0.2]])
    assert (MeshDistance(mesh)(inside) < 0).all()
    assert (MeshDistance(mesh)(outside) > 0).all()


def test_a_mug_stays_hollow() -> None:
    """Inside the 4 mm wall is inside, in the bore is outside, on a grid coarser than the wall's half as well."""
    mesh = of(cup())
    wall = SHIFT + np.array([[0.038, 0, 0.05], [0, -0.038, 0.02], [0.01, 0.01, 0.002]])
    bore = SHIFT + np.array([[0, 0, 0.05], [0.03, 0, 0.02], [0, 0, 0.085]])
    grid = sampled(MeshDistance(mesh), mesh.bounds[0] - 0.01, mesh.bounds[1] + 0.01, 0.0015)
    for distance in (MeshDistance(mesh), sampler(grid)):
        assert (distance(wall) < -1e-3).all()
        assert (distance(bore) > 5e-3).all()


def crossing_bars() -> list[trimesh.Trimesh]:
    """Two crossing bars of 10 x 2 x 2 cm with flush tops and bottoms, and a cube of 1 cm in the middle of both."""
    return [trimesh.creation.box(size) for size in ((0.1, 0.02, 0.02), (0.02, 0.1, 0.02), (0.01, 0.01, 0.01))]


def turned(mesh: trimesh.Trimesh) -> trimesh.Trimesh:
    """The mesh inside out."""
    return trimesh.Trimesh(mesh.vertices, mesh.faces[:, ::-1], process=False)


@pytest.mark.parametrize("inside_out", [(), (0,), (1,), (0, 1), (0, 1, 2)])
def test_overlapping_pieces_are_one_solid_however_each_is_wound(inside_out: tuple[int, ...]) -> None:
    """Flush faces, overlaps and nested pieces: points are inside where any bar is."""
    pieces = [turned(one) if i in inside_out else one for i, one in enumerate(crossing_bars())]
    mesh = of(trimesh.util.concatenate(pieces))
    points = np.random.default_rng(2).uniform(-0.06, 0.06, (4000, 3))
    half = np.array([[0.05, 0.01, 0.01], [0.01, 0.05, 0.01]])
    expected = np.any(np.all(np.abs(points)[:, None] < half, axis=2), axis=1)
    assert (MeshDistance(mesh).inside(SHIFT + points) == expected).all()


@pytest.mark.parametrize("all_turned", [False, True])
def test_a_shell_within_another_wound_the_other_way_is_a_hollow(all_turned: bool) -> None:
    """A box with a hollow and a core in it, as modelled and with everything inside out."""
    boxes = [trimesh.creation.box((size, size, size)) for size in (0.1, 0.06, 0.02)]
    pieces = [boxes[0], turned(boxes[1]), boxes[2]]
    mesh = of(trimesh.util.concatenate([turned(one) for one in pieces] if all_turned else pieces))
    distance = MeshDistance(mesh)
    inside = distance.inside(SHIFT + np.array([[0.04, 0, 0], [0.02, 0, 0], [0, 0, 0], [0.06, 0, 0]]))
    assert inside.tolist() == [True, False, True, False]
    assert distance.volume == pytest.approx(0.1**3 - 0.06**3 + 0.02**3)


def test_every_sample_in_the_band_is_exact_also_beside_thin_walls() -> None:
    """Samples within BAND of the surface are those of the exact distance to single precision, and all others lie beyond
    the band on the right side: of a cup whose wall is as thick as two samples, between which no coarse sample lies."""
    spacing = 3e-3
    mesh = of(cup(wall=6e-3))
    grid = sampled(MeshDistance(mesh), mesh.bounds[0] - 0.02, mesh.bounds[1] + 0.02, spacing)
    exact = MeshDistance(mesh)(lattice(grid.origin, spacing, np.array(grid.values.shape)))
    found = grid.values.ravel().astype(np.float64)
    band = np.abs(exact) < BAND * spacing
    assert np.abs(found - exact)[band].max() < 1e-6
    assert (np.abs(found)[~band] >= BAND * spacing - 1e-6).all()
    assert ((found < 0.0) == (exact < 0.0))[np.abs(exact) > 1e-6].all()


def test_impossible_grids_are_refused() -> None:
    """An inverted box, or one that would take gigabytes, is refused before anything is allocated."""
    mesh = of(trimesh.creation.box((0.1, 0.1, 0.1)))
    with pytest.raises(GeometryError, match="high > low"):
        sampled(MeshDistance(mesh), np.ones(3), np.zeros(3), 0.01)
    with pytest.raises(GeometryError, match="raise its spacing"):
        sampled(MeshDistance(mesh), np.zeros(3), np.ones(3), 1e-4)
    with pytest.raises(GeometryError, match="without faces"):
        MeshDistance(Mesh.of(np.zeros((0, 3)), np.zeros((0, 3))))(np.zeros((1, 3)))
