"""Rays against a triangle mesh: first hits and occlusion.

In: a mesh and rays in its frame. Out: hits with geometric normals as wound in the mesh. A surface is hit from both
sides. Rays are traced by Embree in single precision: hits are accurate to about 1e-6 of the distance.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING, Protocol, TypeVar

import numpy as np
from numpy.typing import NDArray

from dcap.scene.types.mesh import Mesh

if TYPE_CHECKING:
    import open3d  # takes half a second, which cached results need not wait for

FloatArray = NDArray[np.floating]
Packed = NDArray[np.float32]
IndexT = TypeVar("IndexT", bound=np.integer)


ASLANT = np.array([0.3517, 0.4793, 0.8041])
"""A direction along which hardly any face of a room lies."""
MOST_FLUSH = 8
"""Maximum number of places with coinciding opposite faces through which a ray is followed."""
FLUSH = 1e-4
"""Largest distance of coinciding faces [m]."""
GRAZING = 0.1
"""Cosine between a ray and a face's normal below which the ray runs along the face, not through it."""


@dataclass(frozen=True, eq=False, slots=True)
class Hits:
    """First hits of n rays."""

    distance: NDArray[np.float64]
    """Distance along the ray [m], inf on a miss, shape (n,)."""
    face: NDArray[np.int32]
    """Index of the face hit, -1 on a miss, shape (n,)."""
    normal: NDArray[np.float64]
    """Unit geometric normal as wound, zero on a miss, shape (n, 3)."""
    position: NDArray[np.float64]
    """Hit point [m], nan on a miss, shape (n, 3)."""
    barycentric: NDArray[np.float64]
    """Weights of the face's three corners, shape (n, 3)."""


@dataclass(frozen=True, eq=False, slots=True)
class PackedHits:
    """First hits of n rays as the ray tracer returns them."""

    distance: NDArray[np.float32]
    """Distance in lengths of the ray's direction, inf on a miss, shape (n,)."""
    face: NDArray[np.int32]
    """Index of the face hit, -1 on a miss, shape (n,)."""
    normal: NDArray[np.float32]
    """Unit geometric normal as wound, undefined on a miss, shape (n, 3)."""
    uv: NDArray[np.float32]
    """Weights of the face's second and third corner, undefined on a miss, shape (n, 2)."""

    def part(self, index: slice) -> "PackedHits":
        """A part of the rays, without a copy."""
        return PackedHits(self.distance[index], self.face[index], self.normal[index], self.uv[index])


class RayTracer(Protocol):
    """Finds the ends of packed rays, shape (n, 6)."""

    def first_hits(self, packed: Packed) -> PackedHits:
        """Return the first hits of rays."""

    def blocked(self, packed: Packed) -> NDArray[np.bool_]:
        """Mask of the rays that hit anything within the length of their direction, shape (n,)."""


class Raycaster:
    """A mesh prepared for many rays; holds the acceleration structure."""

    def __init__(self, mesh: Mesh, faces: NDArray[np.integer] | None = None) -> None:
        """Prepare all faces of a mesh, or some of them (k,), which keep their indices in the mesh."""
        import open3d

        self._mesh, self._faces = mesh, faces
        used = mesh.faces if faces is None else mesh.faces[faces]
        self._empty = len(used) == 0
        # a miss has index -1, which selects the last row
        self._number = None if faces is None else np.append(faces, -1).astype(np.int32)
        self._scene = open3d.t.geometry.RaycastingScene()
        if not self._empty:
            self._scene.add_triangles(tensor(mesh.vertices), tensor(used, np.uint32))

    def cast(self, origins: FloatArray, directions: FloatArray) -> Hits:
        """First hits of rays with origins [m] and unit directions, each of shape (n, 3)."""
        count = len(origins)
        if self._empty or count == 0:
            return misses(count)
        found = self.first_hits(packed_rays(origins, directions))
        distance = found.distance.astype(np.float64)
        hit = np.isfinite(distance)
        normal = np.where(hit[:, None], found.normal, 0.0).astype(np.float64)
        u, v = found.uv.astype(np.float64).T
        position = np.full((count, 3), np.nan)
        position[hit] = origins[hit] + distance[hit, None] * directions[hit]
        return Hits(distance, found.face, normal, position, np.stack([1.0 - u - v, u, v], axis=1))

    def occluded(
        self, origins: FloatArray, directions: FloatArray, distance: float | FloatArray = np.inf
    ) -> NDArray[np.bool_]:
        """Mask of the rays that hit anything nearer than `distance` [m] (a number or shape (n,)), shape (n,)."""
        count = len(origins)
        if self._empty or count == 0:
            return np.zeros(count, dtype=bool)
        limit = np.asarray(distance, dtype=np.float32)
        if limit.ndim == 0:
            blocked = self._scene.test_occlusions(rays(origins, directions), 0.0, float(limit))
            return np.asarray(blocked.numpy(), dtype=bool)
        return self.blocked(packed_rays(origins, directions * limit[:, None]))

    @cached_property
    def _both_sides(self) -> tuple["Raycaster", "Raycaster"]:
        """Ray tracers of the faces that face along one direction and of all others. A single tracer would choose
        between two coinciding faces differently on different processors."""
        number = np.arange(len(self._mesh.faces)) if self._faces is None else self._faces
        a, b, c = self._mesh.corners(number).transpose(1, 0, 2)
        ahead = np.cross(b - a, c - a) @ ASLANT > 0.0
        return Raycaster(self._mesh, number[ahead]), Raycaster(self._mesh, number[~ahead])

    def left_at(self, origins: FloatArray, directions: FloatArray) -> NDArray[np.float64]:
        """Distance along rays at which they leave the solid in which they begin [m], shape (n,); inf for rays that meet
        a surface from outside, or none.

        If a ray meets coinciding faces of opposite directions, either a thing stands flush on another, or a sheet has
        two sides. The next hit of the ray decides: after a flush contact it leaves the second thing, too.
        """
        start, going = np.array(origins, dtype=np.float64), np.arange(len(origins))
        left, first = np.full(len(origins), np.inf), np.zeros(len(origins))
        for turn in range(MOST_FLUSH):
            way = directions[going]
            hits = [one.cast(start[going], way) for one in self._both_sides]
            near = np.minimum(hits[0].distance, hits[1].distance)
            along = [np.where(h.distance <= near + FLUSH, np.einsum("ij,ij->i", h.normal, way), 0.0) for h in hits]
            out, into = np.maximum(*along) > GRAZING, np.minimum(*along) < -GRAZING
            if turn == 0:
                first = near  # later hits of a ray lie behind it
            leaving = going[out & ~into]
            left[leaving] = first[leaving]
            both = out & into
            start[going[both]] += (near[both, None] + 2.0 * FLUSH) * way[both]
            going = going[both]
        return left

    def nearest_facing(self, points: FloatArray) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """The nearest point of the surface [m] and the unit normal of its face, nan for an empty mesh, shape (n, 3)
        each."""
        if self._empty or len(points) == 0:
            return np.full((len(points), 3), np.nan), np.full((len(points), 3), np.nan)
        found = self._scene.compute_closest_points(tensor(points))
        place, normal = (found[name].numpy().astype(np.float64) for name in ("points", "primitive_normals"))
        return place, normal

    def distance_to(self, points: FloatArray) -> NDArray[np.float64]:
        """Distance of points (n, 3) from the surface [m], inf for an empty mesh, shape (n,)."""
        if self._empty or len(points) == 0:
            return np.full(len(points), np.inf)
        return np.asarray(self._scene.compute_distance(tensor(points)).numpy(), dtype=np.float64)

    def first_hits(self, packed: Packed) -> PackedHits:
        """Return the first hits of rays with origin and direction in the six columns, shape (n, 6)."""
        if self._empty or len(packed) == 0:
            nothing = np.zeros((len(packed), 3), dtype=np.float32)
            return PackedHits(
                np.full(len(packed), np.inf, dtype=np.float32), np.full(len(packed), -1, dtype=np.int32), nothing,
                nothing[:, :2],
            )  # fmt: skip
        found = self._scene.cast_rays(tensor(packed))
        # a miss is marked by the largest 32-bit number
        face = self._in_mesh(found["primitive_ids"].numpy().view(np.int32))
        return PackedHits(
            found["t_hit"].numpy(), face, found["primitive_normals"].numpy(), found["primitive_uvs"].numpy()
        )

    def blocked(self, packed: Packed) -> NDArray[np.bool_]:
        """Mask of the rays (n, 6) that hit anything within the length of their direction, shape (n,); never true for
        zero length."""
        if self._empty or len(packed) == 0:
            return np.zeros(len(packed), dtype=bool)
        return np.asarray(self._scene.test_occlusions(tensor(packed), 0.0, 1.0).numpy(), dtype=bool)

    def _in_mesh(self, face: NDArray[IndexT]) -> NDArray[IndexT]:
        """Indices in the whole mesh of faces numbered by the ray tracer."""
        return face if self._number is None else self._number[face].astype(face.dtype, copy=False)


class JoinedTracers:
    """Two tracers for faces of the same mesh, combined."""

    def __init__(self, first: RayTracer, second: RayTracer) -> None:
        self._first, self._second = first, second

    def first_hits(self, packed: Packed) -> PackedHits:
        """Return the first hits of rays with either."""
        one, two = self._first.first_hits(packed), self._second.first_hits(packed)
        nearer = two.distance < one.distance
        wide = nearer[:, None]
        return PackedHits(
            np.where(nearer, two.distance, one.distance), np.where(nearer, two.face, one.face),
            np.where(wide, two.normal, one.normal), np.where(wide, two.uv, one.uv),
        )  # fmt: skip

    def blocked(self, packed: Packed) -> NDArray[np.bool_]:
        """Mask of the rays that hit anything of either within the length of their direction."""
        stopped = self._first.blocked(packed)
        going = np.flatnonzero(~stopped)
        stopped[going] = self._second.blocked(packed[going])
        return stopped


def misses(count: int) -> Hits:
    """Hits of rays that miss everything."""
    return Hits(
        np.full(count, np.inf),
        np.full(count, -1, dtype=np.int32),
        np.zeros((count, 3)),
        np.full((count, 3), np.nan),
        np.zeros((count, 3)),
    )


def rays(origins: FloatArray, directions: FloatArray) -> "open3d.core.Tensor":
    """Packed rays in the ray tracer's array type."""
    return tensor(packed_rays(origins, directions))


def packed_rays(origins: FloatArray, directions: FloatArray) -> Packed:
    """Origins and directions as the six columns of the ray tracer."""
    packed = np.empty((len(origins), 6), dtype=np.float32)
    packed[:, :3], packed[:, 3:] = origins, directions
    return packed


def tensor(array: NDArray[np.generic], kind: type[np.generic] = np.float32) -> "open3d.core.Tensor":
    """An array of the given type, without a copy if it already has that type."""
    import open3d

    return open3d.core.Tensor.from_numpy(np.ascontiguousarray(array, dtype=kind))
