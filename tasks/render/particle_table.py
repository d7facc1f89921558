"""The material of soft bodies at rest as a table and an iso-surface, and their agreement with the settled surfaces.

In: the settled state and its particles. Out: columns of a table, meshes, and measures.
"""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from skimage.measure import marching_cubes

from dcap.arrays import Array
from dcap.geometry.distance import Distance
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.particles import Particles, SoftSimulationBody
from dcap.scene.types.settled import Settled, SettledMaterial
from solver.motion import MaterialState

MOST_CELLS = 1_500_000
"""Maximum number of cells in the grid of an iso-surface [-]."""
NEIGHBOURS = 4
"""Number of material points for tracing a position back [-]."""
COMPONENTS = ("xx", "yy", "zz", "yz", "xz", "xy")


def soft_bodies(settled: Settled) -> list[tuple[int, MaterialState]]:
    """Indices and materials of the soft bodies."""
    return [(number, one) for number, one in enumerate(settled.material) if one is not None]


def settled_materials(settled: Settled) -> list[SettledMaterial]:
    """Measures of the soft bodies at rest."""
    rows = []
    for number, one in soft_bodies(settled):
        body = settled.bodies[number]
        away = cKDTree(one.start + one.displacement).query(body.surface.vertices, workers=-1)[0]
        rows.append(
            SettledMaterial(
                body=body.name,
                points=len(one.start),
                volume_before_m3=float(one.volume.sum()),
                volume_m3=float((one.volume * one.volume_ratio).sum()),
                largest_displacement_m=float(np.linalg.norm(one.displacement, axis=1).max()),
                largest_stress_pa=float(von_mises(one.stress).max()),
                surface_to_points_mean_m=float(away.mean()),
                surface_to_points_max_m=float(away.max()),
            )
        )
    return rows


def von_mises(stress: Array) -> Array:
    """Von Mises stress [Pa] of the components xx, yy, zz, yz, xz, xy (p, 6), shape (p,)."""
    xx, yy, zz, yz, xz, xy = stress.T
    square = 0.5 * ((xx - yy) ** 2 + (yy - zz) ** 2 + (zz - xx) ** 2) + 3.0 * (yz**2 + xz**2 + xy**2)
    return np.asarray(np.sqrt(square))


def particle_columns(settled: Settled, particles: Particles) -> Mapping[str, NDArray[np.generic]]:
    """A row per material point: body, place at rest, displacement, volume, stress and constants; SI units."""
    columns: dict[str, list[NDArray[np.generic]]] = {}
    for number, one in soft_bodies(settled):
        place = one.start + one.displacement
        values: dict[str, NDArray[np.generic]] = {"body": np.full(len(place), settled.bodies[number].name)}
        values |= {name: place[:, k].astype(np.float32) for k, name in enumerate("xyz")}
        values |= {f"displacement_{name}": one.displacement[:, k].astype(np.float32) for k, name in enumerate("xyz")}
        values |= {"volume_before": one.volume, "volume_ratio": one.volume_ratio.astype(np.float32)}
        values |= {f"stress_{name}": one.stress[:, k].astype(np.float32) for k, name in enumerate(COMPONENTS)}
        values["von_mises"] = von_mises(one.stress).astype(np.float32)
        body = particles.bodies[number]
        assert isinstance(body, SoftSimulationBody)
        same = cKDTree(body.points.position).query(one.start, workers=-1)[1]  # the solver sorts them by cell
        for name in ("density", "youngs_modulus", "poisson_ratio"):
            values[name] = getattr(body.points, name)[same]
        for name, column in values.items():
            columns.setdefault(name, []).append(column)
    return {name: np.concatenate(parts) for name, parts in columns.items()}


def iso_surface(one: MaterialState, start: Distance) -> Mesh:
    """The surface around the material of a body at rest: the zero level of the distance from the material's surface.

    A position at rest is traced back to the start by the displacements of the nearest material points, and `start`, the
    signed distance of the body's surface before the drop, is evaluated there. The surface therefore does not depend on
    the spacing of the points. If a body was cut off, the surface ends with its points.
    """
    place = one.start + one.displacement
    size = np.cbrt(one.volume)
    rim = float(np.quantile(size, 0.9))
    low, high = place.min(axis=0) - 2.0 * rim, place.max(axis=0) + 2.0 * rim
    cell = max(float(np.quantile(size, 0.1)), float(np.cbrt(np.prod(high - low) / MOST_CELLS)))
    axes = [np.arange(low[a], high[a] + cell, cell) for a in range(3)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    away, near = cKDTree(place).query(points, k=min(NEIGHBOURS, len(place)), workers=-1)
    away, near = away.reshape(len(points), -1), near.reshape(len(points), -1)
    weight = 1.0 / (away**2 + (1e-3 * cell) ** 2)
    moved = np.einsum("nk,nki->ni", weight, one.displacement[near]) / weight.sum(axis=1, keepdims=True)
    began = points - moved
    kept_low, kept_high = one.start.min(axis=0), one.start.max(axis=0)
    beyond = np.maximum(kept_low - began, began - kept_high).max(axis=1) - 0.5 * rim
    values = np.maximum(start(began), beyond).reshape([len(one) for one in axes])
    vertices, faces, _, _ = marching_cubes(values, 0.0, spacing=(cell,) * 3)  # type: ignore[no-untyped-call]
    return Mesh.of(vertices + low, faces, (150, 170, 200))


def distances(surface: Mesh, one: MaterialState) -> dict[str, float]:
    """Distances of a surface's vertices from the nearest material point at rest [m]."""
    away = cKDTree(one.start + one.displacement).query(surface.vertices, workers=-1)[0]
    return {"to_points_mean_m": float(away.mean()), "to_points_max_m": float(away.max())}
