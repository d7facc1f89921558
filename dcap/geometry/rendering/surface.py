"""Surface that the rays of a camera meet: position, normals, colour and mesh, ready for lighting.

Shading normals: smooth where a surface bends gently, sharp at its edges.

In: a mesh, welded or not, wound consistently or not. Out: unit normals per face corner. A face averages its neighbours'
normals at each corner, weighted by area and by their agreement with its own normal.

Processes many pixels in bands: small enough to stay in a core's cache, several at a time.

The bounds of a band depend only on the number of pixels, so results do not depend on the number of cores.
"""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from copy import copy
from dataclasses import dataclass, fields
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_array

from dcap.arrays import Float32Array
from dcap.cores import available_cores
from dcap.geometry.camera import Camera
from dcap.geometry.pieces import welded
from dcap.geometry.raycast import JoinedTracers, PackedHits, RayTracer
from dcap.geometry.rendering.painted import PaintedScene, caster_of
from dcap.geometry.rendering.view_volume import in_view
from dcap.scene.srgb import LINEAR
from dcap.scene.types.mesh import Mesh, PaintedMesh

BAND = 16384
"""Pixels in a band: an array of vectors takes 200 KB, so that half a dozen fit into the second-level cache."""
SHARP_COS, SMOOTH_COS = 0.5, 0.85  # 60 degrees and more: an edge; 32 degrees and less: a bend; blended in between
FACES = 4096  # in a band: each has about 18 neighbours, counted once for each corner

HIGH, LOW = np.radians([52.0, 24.0])
"""Elevations of the key light [rad]; the low one grazes level surfaces, which makes their relief visible."""
LEAN_COS = 0.1  # a shading normal that leans farther from its face would shade the hidden side


def in_bands(action: Callable[[slice], None], count: int, band: int = BAND) -> None:
    """Call `action` with slices that cut range(count) into bands, on all cores; it must only write its own band."""
    cuts = [slice(first, min(first + band, count)) for first in range(0, count, band)]
    workers = min(available_cores(), len(cuts))
    if workers < 2:
        for cut in cuts:
            action(cut)
        return
    with ThreadPoolExecutor(workers) as pool:
        for _ in pool.map(action, cuts):  # raises the exception of a band
            pass


class ShadingNormals:
    """Corner normals of a mesh, computed on demand and kept."""

    def __init__(self, mesh: Mesh) -> None:
        area_normal = mesh.face_normals
        self._length = np.sqrt(np.einsum("ij,ij->i", area_normal, area_normal))
        self._unit = np.ascontiguousarray((area_normal / np.maximum(self._length, 1e-300)[:, None]).T)
        self._corner = welded(mesh.vertices)[mesh.faces]
        self._start, self._order = grouped(self._corner.ravel())
        self._known = np.zeros(len(mesh.faces), dtype=bool)
        self._normal = np.zeros((len(mesh.faces), 3, 3), dtype=np.float32)

    def of_corners(self, face: NDArray[np.integer]) -> NDArray[np.float32]:
        """Unit normals at the three corners of all faces, shape (m, 3, 3); computed for the faces (n,) and earlier
        ones."""
        wanted = np.zeros(len(self._known), dtype=bool)
        wanted[face] = True
        fresh = np.flatnonzero(wanted & ~self._known)

        def average(band: slice) -> None:
            self._normal[fresh[band]] = self._averaged(fresh[band])

        in_bands(average, len(fresh), band=FACES)
        self._known[fresh] = True
        return self._normal

    def _averaged(self, face: NDArray[np.integer]) -> NDArray[np.float32]:
        """Weighted means over the faces around each corner."""
        vertex = self._corner[face].ravel()
        count = self._start[vertex + 1] - self._start[vertex]
        slot = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
        other = self._order[np.repeat(self._start[vertex], count) + slot] // 3
        target = np.repeat(np.arange(len(vertex)), count)
        own, near = self._unit[:, face[target // 3]], self._unit[:, other]
        cos = own[0] * near[0] + own[1] * near[1] + own[2] * near[2]
        weight = self._length[other] * np.sign(cos)  # a neighbour wound the other way is reversed
        weight *= np.clip((np.abs(cos) - SHARP_COS) / (SMOOTH_COS - SHARP_COS), 0.0, 1.0)
        total = np.stack([np.bincount(target, weight * part, minlength=len(vertex)) for part in near], axis=1)
        size = np.sqrt(np.einsum("ij,ij->i", total, total))[:, None]
        total = np.divide(total, size, out=np.repeat(self._unit.T[face], 3, axis=0), where=size > 0.0)
        return np.asarray(total.reshape(-1, 3, 3), dtype=np.float32)


def grouped(number: NDArray[np.int64]) -> tuple[NDArray[np.integer], NDArray[np.integer]]:
    """Start of the places of each number in a list of places, and that list in order, shapes (k + 1,) and (n,): a
    counting sort, four times as fast as a comparison sort."""
    places = np.arange(len(number))
    rows = csr_array((np.ones(len(number), dtype=bool), (number, places)))
    return rows.indptr, rows.indices


@dataclass(frozen=True, eq=False, slots=True)
class SurfaceHits:
    """Hits of n rays from one camera; zeros on a miss. Component-first arrays: (3, n)."""

    direction: Float32Array
    """Unit ray directions, shape (3, n)."""
    distance: Float32Array
    """Distance along the ray [m], inf on a miss, shape (n,)."""
    position: Float32Array
    """Hit points [m], shape (3, n)."""
    flat: Float32Array
    """Unit face normals towards the viewer, shape (3, n)."""
    smooth: Float32Array
    """Unit shading normals, shape (3, n)."""
    color: Float32Array
    """Linear colours 0..1, shape (3, n)."""
    mesh_index: NDArray[np.int32]
    """Index of the visible mesh, -1 for none, shape (n,)."""
    face: NDArray[np.int32]
    """Face of the joined mesh, -1 for none, shape (n,)."""
    corner_weights: Float32Array
    """Weights of that face's corners, zeros for none, shape (3, n)."""

    @classmethod
    def empty(cls, count: int) -> "SurfaceHits":
        """Arrays to be filled."""
        vectors = [np.empty((3, count), dtype=np.float32) for _ in range(6)]
        way, position, flat, smooth, color, weights = vectors
        return cls(
            way, np.empty(count, dtype=np.float32), position, flat, smooth, color, np.empty(count, dtype=np.int32),
            np.empty(count, dtype=np.int32), weights,
        )  # fmt: skip

    def part(self, index: slice) -> "SurfaceHits":
        """A part of the rays, without a copy."""
        return SurfaceHits(
            self.direction[:, index], self.distance[index], self.position[:, index], self.flat[:, index],
            self.smooth[:, index], self.color[:, index], self.mesh_index[index], self.face[index],
            self.corner_weights[:, index],
        )  # fmt: skip

    def at(self, index: NDArray[np.integer]) -> "SurfaceHits":
        """The rays with given indices (k,)."""
        return SurfaceHits(*(getattr(self, one.name)[..., index] for one in fields(self)))

    def with_others(self, index: NDArray[np.integer], others: "SurfaceHits") -> "SurfaceHits":
        """A copy with some of the rays (k,) replaced by others."""
        result = SurfaceHits(*(getattr(self, one.name).copy() for one in fields(self)))
        for one in fields(self):
            getattr(result, one.name)[..., index] = getattr(others, one.name)
        return result


class PreparedMeshes:
    """Meshes for any number of cameras, each of which may see some of the faces: colours, normals and textures."""

    def __init__(self, things: Sequence[Mesh | PaintedMesh]) -> None:
        self.things = [PaintedMesh(one) if isinstance(one, Mesh) else one for one in things]
        meshes = [one.mesh for one in self.things]
        self.mesh = Mesh.concatenate(meshes)
        self.mesh_of_face = np.repeat(np.arange(len(meshes)), [len(m.faces) for m in meshes]).astype(np.int32)
        self.colors = LINEAR[self.mesh.colors]
        self.normals = ShadingNormals(self.mesh)
        self.textures = PaintedScene(self.things) if any(one.paint for one in self.things) else None
        self.shown = np.ones(len(self.mesh.faces), dtype=bool)
        """Mask of the visible faces, shape (m,)."""

    def showing(self, faces: NDArray[np.bool_]) -> Self:
        """A copy with only some faces (m,) visible."""
        some = copy(self)
        some.shown = faces
        return some


class RenderScene:
    """Prepared meshes for one camera: the faces that its rays may meet, and the light."""

    def __init__(self, prepared: PreparedMeshes, camera: Camera, *, low_light: bool = False) -> None:
        self.prepared = prepared
        self.camera = camera
        self.light = key_direction(camera, LOW if low_light else HIGH)
        self.reach = float(np.linalg.norm(np.asarray(camera.target) - camera.position))
        self.caster: RayTracer = self._caster_of(prepared.shown)

    def adding(self, faces: NDArray[np.bool_]) -> tuple[Self, RayTracer]:
        """A scene for the same camera with additional faces (m,) of the meshes, and a ray caster of these faces
        alone."""
        more, added = copy(self), self._caster_of(faces)
        more.prepared = self.prepared.showing(self.prepared.shown | faces)
        more.caster = JoinedTracers(self.caster, added)
        return more, added

    def _caster_of(self, faces: NDArray[np.bool_]) -> RayTracer:
        """A ray caster of those of the given faces (m,) that rays of the picture may meet."""
        known = self.prepared
        near = faces & in_view(known.mesh, self.camera, self.light, self.reach)
        return caster_of(known.things, known.mesh, np.flatnonzero(near))

    def look(self, points: NDArray[np.float64]) -> SurfaceHits:
        """Hits of rays through image points (n, 2) [pixel]."""
        rays = np.empty((len(points), 6), dtype=np.float32)
        surface = SurfaceHits.empty(len(points))

        def aim(band: slice) -> None:
            rays[band, :3] = self.camera.position
            rays[band, 3:] = self.camera.directions(points[band])

        in_bands(aim, len(points))
        hits = self.caster.first_hits(rays)
        corner_normals = self.prepared.normals.of_corners(hits.face[hits.face >= 0])

        def describe(band: slice) -> None:
            self._describe(rays[band], hits.part(band), corner_normals, surface.part(band))

        in_bands(describe, len(points))
        return surface

    def _describe(self, rays: Float32Array, hits: PackedHits, corner_normals: Float32Array, out: SurfaceHits) -> None:
        """Fill in the hits of a band of rays."""
        known = self.prepared
        out.direction[:] = rays[:, 3:].T
        out.distance[:] = hits.distance
        out.face[:] = hits.face
        seen = hits.face >= 0
        if not seen.any():
            out.mesh_index[:] = -1
            for nothing in (out.position, out.flat, out.smooth, out.color, out.corner_weights):
                nothing[:] = 0.0
            return
        face = np.where(seen, hits.face, 0)
        out.position[:] = np.where(seen, rays[:, :3].T + np.where(seen, hits.distance, 0.0) * out.direction, 0.0)
        out.mesh_index[:] = np.where(seen, known.mesh_of_face[face], -1)
        u, v = np.where(seen, hits.uv.T, 0.0)
        weights = out.corner_weights
        weights[0], weights[1], weights[2] = seen - u - v, u, v
        out.color[:] = sum(
            w * components(known.colors[k]) for w, k in zip(weights, known.mesh.faces[face].T, strict=True)
        )
        if known.textures is not None:
            pixel = np.where(seen, hits.distance, 1.0).astype(np.float32) / np.float32(self.camera.focal)
            known.textures.paint(face, weights, pixel, out.color)
        flat = np.where(seen, components(hits.normal), 0.0)
        rows = components(corner_normals.reshape(-1, 9)[face])
        smooth = weights[0] * rows[:3] + weights[1] * rows[3:6] + weights[2] * rows[6:]
        toward = np.where(dot(flat, out.direction) > 0.0, np.float32(-1.0), np.float32(1.0))
        flat *= toward
        smooth *= toward
        smooth = np.where(dot(smooth, flat) > LEAN_COS, smooth, flat)
        out.flat[:] = flat
        out.smooth[:] = smooth / np.maximum(np.sqrt(dot(smooth, smooth)), np.float32(1e-12))


def components(rows: Float32Array) -> Float32Array:
    """Vectors (n, k) in component-first order, shape (k, n)."""
    return np.ascontiguousarray(rows.T)


def dot(a: Float32Array, b: Float32Array) -> Float32Array:
    """Scalar products of component-first vectors, shape (3, ...)."""
    return np.asarray(a[0] * b[0] + a[1] * b[1] + a[2] * b[2])


def key_direction(camera: Camera, elevation: float) -> NDArray[np.float64]:
    """Unit vector to the key light: over the left shoulder of the photographer, at an elevation [rad]."""
    rotation = camera.world_from_camera
    side = -0.75 * rotation[:, 0] - 0.55 * rotation[:, 2] * (1.0, 1.0, 0.0)
    flat = side * (1.0, 1.0, 0.0)
    flat /= max(float(np.linalg.norm(flat)), 1e-9)
    return np.asarray(np.cos(elevation) * flat + np.array([0.0, 0.0, np.sin(elevation)]))
