"""Material at rest: stress measures, iso-surfaces and figures of bodies that are known by formula."""

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from dented_bed import settled

from solver.motion import MaterialState
from tasks.render.particle_table import distances, iso_surface, settled_materials, soft_bodies, von_mises

RADIUS, STEP = 0.1, 0.005


def ball_of_points(ratio: float = 1.0) -> MaterialState:
    """Points on a grid inside a sphere, moved up by 0.3 m."""
    line = np.arange(-RADIUS, RADIUS, STEP) + STEP / 2
    grid = np.stack(np.meshgrid(line, line, line, indexing="ij"), axis=-1).reshape(-1, 3)
    start = grid[np.linalg.norm(grid, axis=1) < RADIUS]
    moved = np.tile([0.0, 0.0, 0.3], (len(start), 1))
    one = np.ones(len(start))
    return MaterialState(start, moved, STEP**3 * one, ratio * one, np.zeros((len(start), 6)))


def test_von_mises_of_known_states():
    """Uniaxial: its size; pressure alone: none; pure shear: sqrt(3) of it."""
    states = np.array([[5.0, 0, 0, 0, 0, 0], [-3.0, -3.0, -3.0, 0, 0, 0], [0, 0, 0, 0, 2.0, 0]])
    assert von_mises(states) == pytest.approx([5.0, 0.0, 2.0 * np.sqrt(3.0)])


def test_an_iso_surface_has_the_volume_and_place_of_its_material():
    one = ball_of_points()
    surface = iso_surface(one, lambda points: np.linalg.norm(points, axis=1) - RADIUS)
    solid = trimesh.Trimesh(surface.vertices, surface.faces)
    assert solid.is_watertight
    assert solid.volume == pytest.approx(4.0 / 3.0 * np.pi * RADIUS**3, rel=0.01)  # positive: faces look outward
    away = np.linalg.norm(surface.vertices - [0.0, 0.0, 0.3], axis=1)
    assert np.abs(away - RADIUS).max() < 0.1 * STEP
    found = distances(surface, one)
    assert 0.0 < found["to_points_mean_m"] < found["to_points_max_m"] < 2.0 * STEP


def test_figures_of_a_settled_body():
    one = replace(ball_of_points(0.99), stress=np.tile([5.0, 0, 0, 0, 0, 0], (len(ball_of_points().start), 1)))
    with_material = replace(settled(), material=(None, one))
    (row,) = settled_materials(with_material)
    assert row.body == settled().bodies[1].name
    assert row.volume_m3 == pytest.approx(0.99 * row.volume_before_m3)
    assert row.largest_displacement_m == pytest.approx(0.3)
    assert row.largest_stress_pa == pytest.approx(5.0)
    assert soft_bodies(settled()) == []
