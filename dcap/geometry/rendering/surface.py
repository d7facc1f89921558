"""Surface that the rays of a camera meet: place, normals, colour and mesh, ready to be lit."""

from collections.abc import Sequence
from copy import copy
from dataclasses import dataclass, fields
from typing import Self

import numpy as np
from numpy.typing import NDArray

from dcap.geometry.camera import Camera
from dcap.geometry.raycast import JoinedTracers, PackedHits, RayTracer
from dcap.geometry.rendering.bands import in_bands
from dcap.geometry.rendering.normals import ShadingNormals
from dcap.geometry.rendering.painted import PaintedScene
from dcap.geometry.rendering.see_through import caster_of
from dcap.geometry.rendering.view_volume import in_view
from dcap.scene.srgb import LINEAR
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.paint import PaintedMesh

Array = NDArray[np.float32]

HIGH, LOW = np.radians([52.0, 24.0])
"""Elevations of the key light; the low one grazes level surfaces, so that one sees their relief."""
LEAN_COS = 0.1  # a shading normal that leans farther from its face would shade the side that is not seen


@dataclass(frozen=True, eq=False, slots=True)
class SurfaceHits:
    """Hits of n rays from one camera; zeros where they meet nothing. One component after the other: (3, n)."""

    direction: Array
    """Unit ray directions, shape (3, n)."""
    distance: Array
    """Along the ray [m], inf where it meets nothing, shape (n,)."""
    position: Array
    """[m], shape (3, n)."""
    flat: Array
    """Unit face normals towards the viewer, shape (3, n)."""
    smooth: Array
    """Unit shading normals, shape (3, n)."""
    color: Array
    """Linear colours 0..1, shape (3, n)."""
    mesh_index: NDArray[np.int32]
    """Mesh seen, -1 for none, shape (n,)."""
    face: NDArray[np.int32]
    """Face of the joined mesh, -1 for none, shape (n,)."""
    corner_weights: Array
    """Weights of that face's corners, zeros for none, shape (3, n)."""

    @classmethod
    def empty(cls, count: int) -> "SurfaceHits":
        """To be filled."""
        vectors = [np.empty((3, count), dtype=np.float32) for _ in range(6)]
        way, position, flat, smooth, color, weights = vectors
        return cls(
            way, np.empty(count, dtype=np.float32), position, flat, smooth, color, np.empty(count, dtype=np.int32),
            np.empty(count, dtype=np.int32), weights,
        )  # fmt: skip

    def part(self, index: slice) -> "SurfaceHits":
        """Some of the rays, without a copy."""
        return SurfaceHits(
            self.direction[:, index], self.distance[index], self.position[:, index], self.flat[:, index],
            self.smooth[:, index], self.color[:, index], self.mesh_index[index], self.face[index],
            self.corner_weights[:, index],
        )  # fmt: skip

    def at(self, index: NDArray[np.integer]) -> "SurfaceHits":
        """Some of the rays (k,)."""
        return SurfaceHits(*(getattr(self, one.name)[..., index] for one in fields(self)))

    def with_others(self, index: NDArray[np.integer], others: "SurfaceHits") -> "SurfaceHits":
        """The same with others in the place of some of the rays (k,)."""
        result = SurfaceHits(*(getattr(self, one.name).copy() for one in fields(self)))
        for one in fields(self):
            getattr(result, one.name)[..., index] = getattr(others, one.name)
        return result


class PreparedMeshes:
    """Meshes that any number of cameras look at, each at some of their faces: colours, normals and textures."""

    def __init__(self, things: Sequence[Mesh | PaintedMesh]) -> None:
        self.things = [PaintedMesh(one) if isinstance(one, Mesh) else one for one in things]
        meshes = [one.mesh for one in self.things]
        self.mesh = Mesh.concatenate(meshes)
        self.mesh_of_face = np.repeat(np.arange(len(meshes)), [len(m.faces) for m in meshes]).astype(np.int32)
        self.colors = LINEAR[self.mesh.colors]
        self.normals = ShadingNormals(self.mesh)
        self.textures = PaintedScene(self.things) if any(one.paint for one in self.things) else None
        self.shown = np.ones(len(self.mesh.faces), dtype=bool)
        """Faces that are looked at, shape (m,)."""

    def showing(self, faces: NDArray[np.bool_]) -> Self:
        """The same with only some faces (m,) looked at."""
        some = copy(self)
        some.shown = faces
        return some


class RenderScene:
    """Prepared meshes as one camera sees them: what its rays may meet of them, and the light."""

    def __init__(self, prepared: PreparedMeshes, camera: Camera, *, low_light: bool = False) -> None:
        self.prepared = prepared
        self.camera = camera
        self.light = key_direction(camera, LOW if low_light else HIGH)
        self.reach = float(np.linalg.norm(np.asarray(camera.target) - camera.position))
        self.caster: RayTracer = self._caster_of(prepared.shown)

    def adding(self, faces: NDArray[np.bool_]) -> tuple[Self, RayTracer]:
        """The same camera before further faces (m,) of the meshes, and a ray caster of these alone."""
        more, added = copy(self), self._caster_of(faces)
        more.prepared = self.prepared.showing(self.prepared.shown | faces)
        more.caster = JoinedTracers(self.caster, added)
        return more, added

    def _caster_of(self, faces: NDArray[np.bool_]) -> RayTracer:
        """A ray caster of some faces (m,), as far as rays of the picture may meet them."""
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

    def _describe(self, rays: Array, hits: PackedHits, corner_normals: Array, out: SurfaceHits) -> None:
        """Fill in what a band of rays meets."""
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


def components(rows: Array) -> Array:
    """Vectors (n, k) one component after the other, shape (k, n)."""
    return np.ascontiguousarray(rows.T)


def dot(a: Array, b: Array) -> Array:
    """Scalar products of vectors with the components first, shape (3, ...)."""
    return np.asarray(a[0] * b[0] + a[1] * b[1] + a[2] * b[2])


def key_direction(camera: Camera, elevation: float) -> NDArray[np.float64]:
    """Unit vector to the key light: over the left shoulder of the photographer, at an elevation [rad]."""
    rotation = camera.world_from_camera
    side = -0.75 * rotation[:, 0] - 0.55 * rotation[:, 2] * (1.0, 1.0, 0.0)
    flat = side * (1.0, 1.0, 0.0)
    flat /= max(float(np.linalg.norm(flat)), 1e-9)
    return np.asarray(np.cos(elevation) * flat + np.array([0.0, 0.0, np.sin(elevation)]))
