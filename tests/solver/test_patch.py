"""The predicted contact of an elastic half-space: closed forms of a ball, a flat punch, a cylinder and two feet."""

import numpy as np
import pytest

from solver.contact.patch import elastic_patch

MODULUS, LOAD = 5.5e5, 9.81
COUNT = 128


def plan(half_x, half_y):
    """Coordinates of the cells' middles (n, n) and their spacing [m]."""
    x, y = (half * (2.0 * (np.arange(COUNT) + 0.5) / COUNT - 1.0) for half in (half_x, half_y))
    return (*np.meshgrid(x, y, indexing="ij"), (2.0 * half_x / COUNT, 2.0 * half_y / COUNT))


def test_a_ball_makes_the_contact_of_hertz():
    """Radius and approach [J85, Eqs. 4.22 and 4.23] within a cell and 1 %, and a width that is the circle's."""
    radius = 0.05
    x, y, spacing = plan(0.015, 0.015)
    patch = elastic_patch((x**2 + y**2) / (2.0 * radius), spacing, LOAD, MODULUS)
    hertz = (0.75 * LOAD * radius / MODULUS) ** (1.0 / 3.0)
    assert np.sqrt(patch.touching.sum() * np.prod(spacing) / np.pi) == pytest.approx(hertz, abs=spacing[0])
    assert patch.approach == pytest.approx(hertz**2 / radius, rel=0.01)
    assert patch.pressure.sum() * np.prod(spacing) == pytest.approx(LOAD, rel=1e-9)
    assert np.nanmax(patch.half_widths(0)) == pytest.approx(hertz, abs=2.0 * spacing[0])


def test_a_flat_punch_sinks_as_boussinesq_says():
    """W / (2 E* a), with the highest pressure at its rim [J85, Sec. 3.4]."""
    a = 0.02
    x, y, spacing = plan(0.025, 0.025)
    patch = elastic_patch(np.where(np.hypot(x, y) <= a, 0.0, np.inf), spacing, LOAD, MODULUS)
    assert patch.approach == pytest.approx(LOAD / (2.0 * MODULUS * a), rel=0.02)
    assert patch.pressure[np.hypot(x, y) < 0.5 * a].max() < 0.5 * patch.pressure.max()
    assert not patch.pressure[np.hypot(x, y) > a].any()


def test_a_lying_cylinder_touches_in_a_strip():
    """Its half width is that of the line contact [J85, Eq. 4.43] away from its ends; along it is the whole length."""
    radius, length = 0.02, 0.2
    _, y, spacing = plan(0.5 * length, 0.006)
    patch = elastic_patch(y**2 / (2.0 * radius), spacing, LOAD, MODULUS)
    strip = np.sqrt(4.0 * LOAD / length * radius / (np.pi * MODULUS))
    assert np.nanmedian(patch.half_widths(1)) == pytest.approx(strip, abs=1.5 * spacing[1])
    assert np.nanmax(patch.half_widths(0)) == pytest.approx(0.5 * length, rel=0.02)


def test_feet_are_resolved_one_by_one():
    """Two narrow feet far apart: each column of cells under a foot knows the foot's width, the others none."""
    x, y, spacing = plan(0.1, 0.05)
    foot = 0.01
    gap = np.where((np.abs(np.abs(x) - 0.08) < foot) & (np.abs(y) < foot), 0.0, np.inf)
    half = elastic_patch(gap, spacing, LOAD, MODULUS).half_widths(0)
    under = np.isfinite(half)
    assert half[under] == pytest.approx(foot, abs=spacing[0])
    assert (np.abs(np.abs(x[under, 0]) - 0.08) < foot + spacing[0]).all()
    assert under.sum() < COUNT // 4


def test_where_bodies_cannot_meet_there_is_no_pressure():
    """An infinite gap stays open, whatever the load."""
    x, y, spacing = plan(0.02, 0.02)
    gap = np.where(x > 0.0, np.inf, (x**2 + y**2) / 0.1)
    patch = elastic_patch(gap, spacing, 50.0, MODULUS)
    assert not patch.pressure[x > 0.0].any()
    assert patch.pressure.sum() * np.prod(spacing) == pytest.approx(50.0)


def test_a_rough_surface_touches_as_a_whole():
    """Grooves much narrower than the patch do not split it, and what carries next to nothing is left out; a smooth one
    is as it was, feet stay apart."""
    x, y = (np.linspace(-0.04, 0.04, 128),) * 2
    spacing = (x[1] - x[0], y[1] - y[0])
    sphere = (x[:, None] ** 2 + y[None, :] ** 2) / 0.2
    smooth = elastic_patch(sphere, spacing, 5.0, 1e5)
    assert (smooth.region == smooth.touching).all()
    rough = elastic_patch(sphere + np.where(np.arange(128) % 8 == 0, np.inf, 0.0)[:, None], spacing, 5.0, 1e5)
    assert np.nanmax(rough.half_widths(0)) == pytest.approx(np.nanmax(smooth.half_widths(0)), rel=0.15)
    feet = np.minimum((x[:, None] - 0.025) ** 2, (x[:, None] + 0.025) ** 2) / 0.02 + y[None, :] ** 2 / 0.02
    two = elastic_patch(feet, spacing, 2.0, 1e6)
    assert not two.region[64, 64]
    crumb = np.where((np.abs(x[:, None] - 0.035) < 1e-3) & (np.abs(y[None, :]) < 1e-3), 0.00185, np.inf)
    beside = elastic_patch(np.minimum(np.where(x[:, None] < 0.03, sphere, np.inf), crumb), spacing, 5.0, 1e5)
    assert beside.touching[x > 0.034].any()
    assert not beside.region[x > 0.034].any()
