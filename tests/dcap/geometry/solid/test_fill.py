"""The particle fill carries the volume of the solid, also where it is thin."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from dcap.geometry.solid.fill import SAMPLES, fill, octants

Planes = tuple[np.ndarray, np.ndarray, np.ndarray]


def planes(low: float, high: float, count: int) -> Planes:
    """A cube of equal cells."""
    line = np.linspace(low, high, count + 1)
    return line, line.copy(), line.copy()


def sphere(points: np.ndarray) -> np.ndarray:
    """Signed distance to a sphere of radius 5 cm."""
    return np.asarray(np.linalg.norm(points, axis=1) - 0.05)


def test_octants_tile_the_grid() -> None:
    """Volumes of all octants add up to the grid's, also with unequal planes, and each lies in its cell."""
    line = np.cumsum([0.0, 0.1, 0.2, 0.4])
    center, size = octants((line, line, line))
    assert np.isclose(size.prod(axis=1).sum(), 0.7**3)
    assert len(center) == 8 * 27
    assert ((center - size / 2 >= -1e-12) & (center + size / 2 <= 0.7 + 1e-12)).all()


def test_sphere_volume_and_centre() -> None:
    """Cut octants are sampled with a smooth step one sub-sample wide: the error is second order in it."""
    cell = 0.12 / 12
    position, volume = fill(planes(-0.06, 0.06, 12), sphere)
    exact = 4.0 / 3.0 * np.pi * 0.05**3
    sub = cell / 2 / SAMPLES
    assert abs(volume.sum() / exact - 1.0) < 3.0 * (sub / 0.05) ** 2 + 2e-3
    assert np.linalg.norm(volume @ position / volume.sum()) < 0.01 * cell


@settings(max_examples=25, deadline=None)
@given(st.floats(-0.004, 0.004), st.floats(0.0008, 0.004))
def test_a_sheet_thinner_than_a_cell_keeps_its_volume(height: float, thickness: float) -> None:
    """No sheet is lost between the sample points: its volume is right within one sub-sample of thickness."""
    cell = 0.01

    def sheet(points: np.ndarray) -> np.ndarray:
        return np.asarray(np.abs(points[:, 2] - height) - 0.5 * thickness)

    _, volume = fill(planes(-0.02, 0.02, 4), sheet)
    assert abs(volume.sum() / 0.04**2 - thickness) < cell / 2 / SAMPLES


def test_volume_varies_smoothly_with_the_surface() -> None:
    """Moving a plane by a little changes the volume by as much, at every position: no jumps between sub-samples."""

    def filled(shift: float) -> float:
        return float(fill(planes(-0.02, 0.02, 4), lambda p: p[:, 2] - shift)[1].sum()) / 0.04**2

    shifts = np.linspace(0.0, 0.005, 41)
    found = [filled(shift) for shift in shifts]
    steps = np.diff(found)
    # the clipped ramp is one sub-sample wide, so its sum has slope one up to rounding
    assert np.allclose(steps, np.diff(shifts), atol=1e-9)


def test_particles_lie_in_their_own_octant() -> None:
    """Moving a particle to the centroid of its share never moves it out of the octant."""
    grid = planes(-0.06, 0.06, 5)
    position, volume = fill(grid, sphere)
    center, size = octants(grid)
    nearest = np.argmin(np.abs(position[:, None] - center[None]).max(axis=2), axis=1)
    assert (np.abs(position - center[nearest]) <= size[nearest] / 2 + 1e-12).all()
    assert len(np.unique(nearest)) == len(position)
    assert (volume > 0).all()
    assert (volume <= size[nearest].prod(axis=1) + 1e-15).all()
