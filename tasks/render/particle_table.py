"""The material of soft bodies at rest as a table and as an iso-surface, and how both agree with the settled surfaces.

In: the settled state and the particles it was made of. Out: columns of a table, meshes, and figures.
"""

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter
from scipy.spatial import cKDTree
from skimage.measure import marching_cubes

from dcap.scene.types.mesh import Mesh
from dcap.scene.types.particles import Particles, SoftSimulationBody
from dcap.scene.types.settled import Settled, SettledMaterial
from solver.motion import MaterialState

Array = NDArray[np.float64]

MOST_CELLS = 8_000_000
"""Cells of the grid of an iso-surface [-]: 64 MB."""
SMOOTHING = 0.8
"""Standard deviation by which the material is smeared before its surface is taken [cells]."""
HALF = 0.5
"""A place is inside where at least this share of it is material [-]."""
COMPONENTS = ("xx", "yy", "zz", "yz", "xz", "xy")


def soft_bodies(settled: Settled) -> list[tuple[int, MaterialState]]:
    """Numbers of the soft bodies and their material."""
    return [(number, one) for number, one in enumerate(settled.material) if one is not None]


def settled_materials(settled: Settled) -> list[SettledMaterial]:
    """The soft bodies at rest in figures."""
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
    """Von Mises stress [Pa] of xx, yy, zz, yz, xz, xy (p, 6), shape (p,)."""
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


def iso_surface(one: MaterialState) -> Mesh:
    """The surface around the material points of a body at rest: where half of the space is material.

    A point's volume is spread over a grid whose cells are as large as the volume of the middle one, or larger where
    that takes more than MOST_CELLS.
    """
    place, volume = one.start + one.displacement, one.volume * one.volume_ratio
    cell = float(np.cbrt(np.median(volume)))
    low, high = place.min(axis=0), place.max(axis=0)
    rim = 4.0
    while np.prod(np.ceil((high - low) / cell) + 2.0 * rim) > MOST_CELLS:
        cell *= 1.1
    shape = (np.ceil((high - low) / cell) + 2.0 * rim).astype(int)
    local = (place - low) / cell + rim - 0.5
    first = np.floor(local).astype(int)
    part = local - first
    share = np.zeros(shape)
    for corner in np.ndindex(2, 2, 2):
        weight = np.prod(np.where(corner, part, 1.0 - part), axis=1)
        np.add.at(share, tuple((first + corner).T), weight * volume / cell**3)
    smooth = gaussian_filter(np.minimum(share, 1.0), SMOOTHING)
    vertices, faces, _, _ = marching_cubes(smooth, HALF)  # type: ignore[no-untyped-call]
    return Mesh.of((vertices - rim + 0.5) * cell + low, faces[:, ::-1], (150, 170, 200))


def distances(surface: Mesh, one: MaterialState) -> dict[str, float]:
    """How far a surface's vertices are from the nearest material point at rest [m]."""
    away = cKDTree(one.start + one.displacement).query(surface.vertices, workers=-1)[0]
    return {"to_points_mean_m": float(away.mean()), "to_points_max_m": float(away.max())}
