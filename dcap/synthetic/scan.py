"""Turns a room of closed solids into a simulated scan: one noisy coloured mesh with holes.

In: surfaces tagged with instance and part. Out: one mesh in which faces hidden inside other solids or lying on the
floor are absent, displaced by smooth and fine noise of about a millimetre, with a few small holes, its faces in
random order; and the truth, which surface each face belongs to.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import open3d
from numpy.typing import NDArray
from pydantic import NonNegativeFloat, NonNegativeInt, PositiveFloat

from dcap.geometry.raycast import tensor
from dcap.scene.types.mesh import Mesh
from dcap.synthetic.paint import smooth_noise
from dcap.synthetic.schema import RecipeModel
from dcap.synthetic.shapes import Array

ON_FLOOR = 0.003
"""Height below which downward faces lie on the floor, unseen by any camera [m]."""


class ScanDefects(RecipeModel):
    """Defects of a scanned surface: noise along its normals, and holes."""

    smooth_noise: NonNegativeFloat = 0.0008
    """Standard deviation of the long-waved noise [m]."""
    rough_noise: NonNegativeFloat = 0.0004
    """Standard deviation of the short-waved noise [m]."""
    fine_noise: NonNegativeFloat = 0.0002
    """Standard deviation of the independent noise per vertex [m]."""
    sheet_noise: NonNegativeFloat = 0.02
    """Share of the noise on walls, floor and ceiling: large planes are scanned flatter [-]."""
    hole_count: NonNegativeInt = 9
    hole_radius: tuple[PositiveFloat, PositiveFloat] = (0.012, 0.03)
    """Smallest and largest hole [m]."""


@dataclass(frozen=True, eq=False, slots=True)
class ScanSurface:
    """A piece of the room's surface."""

    mesh: Mesh
    instance: int
    """Index of the thing it belongs to."""
    part: str
    closed: bool
    """Whether it is a solid that hides its inside; False for the sheets of walls, floor and ceiling."""


@dataclass(frozen=True, eq=False, slots=True)
class RoomScan:
    """The scan and its truth."""

    mesh: Mesh
    face_instance: NDArray[np.int32]
    """Index of the instance of each face, shape (m,)."""
    face_part: NDArray[np.object_]
    """Part name of each face, shape (m,)."""


def scan(surfaces: Sequence[ScanSurface], seed: int, defects: ScanDefects) -> RoomScan:
    """Scan a room."""
    rng = np.random.default_rng(seed)
    visible = [replace(s, mesh=s.mesh.submesh(np.flatnonzero(kept))) for s, kept in
               zip(surfaces, _visible(surfaces), strict=True)]  # fmt: skip
    mesh = Mesh.concatenate([s.mesh for s in visible])
    counts = [len(s.mesh.faces) for s in visible]
    instance = np.repeat(np.array([s.instance for s in visible], dtype=np.int32), counts)
    part = np.repeat(np.array([s.part for s in visible], dtype=object), counts)
    vertex_counts = [len(s.mesh.vertices) for s in visible]
    calm = np.repeat([1.0 if s.closed else defects.sheet_noise for s in visible], vertex_counts)
    mesh = _noisy(mesh, calm, seed, defects, rng)
    order = rng.permutation(np.flatnonzero(~_holes(mesh, defects, rng)))
    return RoomScan(_compact(mesh, order, rng), instance[order], part[order])


def _visible(surfaces: Sequence[ScanSurface]) -> list[NDArray[np.bool_]]:
    """Per surface, the faces that reach out of all other solids and do not lie on the floor.

    A face is hidden if its centre and its three corners are inside other solids: faces at a border stay, so none opens.
    """
    centers = [s.mesh.triangles.mean(axis=1) for s in surfaces]
    points = [np.concatenate([c, s.mesh.vertices]) for s, c in zip(surfaces, centers, strict=True)]
    hidden = [np.zeros(len(p), dtype=bool) for p in points]
    bounds = np.array([s.mesh.bounds for s in surfaces])
    for index, solid in enumerate(surfaces):
        if solid.closed:
            _mark_inside(index, solid.mesh, points, bounds, hidden)
    kept = []
    for surface, center, inside in zip(surfaces, centers, hidden, strict=True):
        count = len(center)
        covered = inside[:count] & inside[count:][surface.mesh.faces].all(axis=1)
        kept.append(~covered & ~((center[:, 2] < ON_FLOOR) & (surface.mesh.face_normals[:, 2] < 0)))
    return kept


def _mark_inside(index: int, solid: Mesh, points: list[Array], bounds: Array, hidden: list[NDArray[np.bool_]]) -> None:
    """Mark the points of all other surfaces that lie in one solid."""
    low, high = bounds[index]
    near = np.flatnonzero((bounds[:, 0] <= high).all(axis=1) & (bounds[:, 1] >= low).all(axis=1))
    asked = [(j, np.flatnonzero(((points[j] > low) & (points[j] < high)).all(axis=1))) for j in near if j != index]
    asked = [(j, chosen) for j, chosen in asked if len(chosen)]
    if not asked:
        return
    inside = _inside(solid, np.concatenate([points[j][chosen] for j, chosen in asked]))
    ends = np.cumsum([len(chosen) for _, chosen in asked])[:-1]
    for (j, chosen), found in zip(asked, np.split(inside, ends), strict=True):
        hidden[j][chosen[found]] = True


def _inside(solid: Mesh, points: Array) -> NDArray[np.bool_]:
    """Whether points (n, 3) lie inside a closed mesh, by ray parity, shape (n,)."""
    caster = open3d.t.geometry.RaycastingScene(nthreads=1)
    caster.add_triangles(tensor(solid.vertices, np.float32), tensor(solid.faces, np.uint32))
    occupied = caster.compute_occupancy(tensor(points, np.float32), nthreads=1, nsamples=3)
    return np.asarray(occupied.numpy() > 0.5)


def _noisy(mesh: Mesh, share: Array, seed: int, defects: ScanDefects, rng: np.random.Generator) -> Mesh:
    """The mesh displaced along its normals, with a little noise in the colours; `share` scales it per vertex."""
    points, normals = mesh.vertices, mesh.vertex_normals
    shift = defects.smooth_noise * smooth_noise(points, seed + 1, 0.35)
    shift += defects.rough_noise * smooth_noise(points, seed + 2, 0.08)
    shift += defects.fine_noise * rng.standard_normal(len(points))
    tint = 1.2 * smooth_noise(points, seed + 3, 0.15) + rng.normal(0.0, 1.0, len(points))
    colors = np.clip(np.rint(mesh.colors + tint[:, None]), 0, 255).astype(np.uint8)
    return replace(mesh, vertices=points + (share * shift)[:, None] * normals, colors=colors)


def _holes(mesh: Mesh, defects: ScanDefects, rng: np.random.Generator) -> NDArray[np.bool_]:
    """Faces in small round holes on steep or downward surfaces, which cameras see worst, shape (m,)."""
    centers, normals = mesh.triangles.mean(axis=1), mesh.face_normals
    candidates = np.flatnonzero(normals[:, 2] < 0.3 * np.linalg.norm(normals, axis=1))
    missing = np.zeros(len(mesh.faces), dtype=bool)
    for seed_face in rng.choice(candidates, defects.hole_count, replace=False):
        radius = rng.uniform(*defects.hole_radius)
        missing |= np.linalg.norm(centers - centers[seed_face], axis=1) < radius
    return missing


def _compact(mesh: Mesh, faces: NDArray[np.int64], rng: np.random.Generator) -> Mesh:
    """The given faces in the given order, with only the vertices they use, these shuffled too."""
    used, inverse = np.unique(mesh.faces[faces], return_inverse=True)
    order = rng.permutation(len(used))
    place = np.empty_like(order)
    place[order] = np.arange(len(order))
    return Mesh(mesh.vertices[used[order]], place[inverse.reshape(-1, 3)].astype(np.int32), mesh.colors[used[order]])
