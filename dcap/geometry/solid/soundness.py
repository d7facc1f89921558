"""How good a closed surface is: well formed, sure of inside and outside, near to the surface it was made of."""

from functools import cached_property

import igl
import numpy as np
from numpy.typing import NDArray

from dcap.arrays import Array
from dcap.geometry.distance import MeshDistance
from dcap.geometry.pieces import is_closed, pieces_of, signed_volume
from dcap.geometry.raycast import Raycaster, tensor
from dcap.geometry.solid.cleaning import face_stacks, heights
from dcap.scene.types.mesh import Mesh

PROBES = 4000  # random points where inside and outside are asked
NEAR = 2e-5  # points nearer than this to the surface are not asked [m]: distances are in single precision
MOST_PLACES = 30_000  # where the distance of the visible surface is measured
FINEST_SPACING = 2e-3  # mean spacing of those places [m] where the surface is small enough
UNMOVED = 2e-6  # distances below this [m] are rounding of single precision
LIFT = 1e-4  # where a look out of a face begins above it [m]
WAYS = np.random.default_rng(1).standard_normal((31, 3))  # generic directions
WAYS /= np.linalg.norm(WAYS, axis=1, keepdims=True)
FREE = 0.7  # share of the ways out of a face that can be seen that lead to no face's back
OPEN = 0.04  # least share of ways out that meet nothing at all: more than one
RAYS = 3  # a grazed edge deceives one


def well_formed(mesh: Mesh) -> bool:
    """Whether it is closed, wound outwards and without degenerate and duplicate faces."""
    if len(mesh.faces) == 0 or not is_closed(mesh) or signed_volume(mesh.vertices, mesh.faces) <= 0.0:
        return False
    key, _, _ = face_stacks(mesh.faces)
    return len(np.unique(key)) == len(mesh.faces) and bool((heights(mesh) > 0.0).all())


def probes(*meshes: Mesh) -> Array:
    """Random points in the common box of meshes, a tenth larger [m], shape (PROBES, 3)."""
    low = np.min([m.bounds[0] for m in meshes], axis=0)
    high = np.max([m.bounds[1] for m in meshes], axis=0)
    margin = 0.05 * (high - low)
    return np.random.default_rng(0).uniform(low - margin, high + margin, (PROBES, 3))


def agreement(mesh: Mesh) -> float:
    """Share of points at which a closed mesh has winding number 0 and even, or 1 and odd, crossings of a ray."""
    import open3d

    field = MeshDistance(mesh)
    points = probes(mesh)
    points = points[field.unsigned(points) > NEAR]
    winding = np.round(field.winding(points))
    caster = open3d.t.geometry.RaycastingScene(nthreads=1)
    caster.add_triangles(tensor(mesh.vertices - field.shift, np.float32), tensor(mesh.faces, np.uint32))
    crossed = caster.compute_occupancy(tensor(points - field.shift, np.float32), nthreads=1, nsamples=RAYS)
    return float((winding == (crossed.numpy() > 0.5)).mean())


def moved(
    given: Mesh, solid: Mesh, *, behind: Mesh | None = None, within: Array | None = None
) -> tuple[float, float, float]:
    """Largest and mean distance from what can be seen of the given faces to a solid's surface, and the spacing of the
    places asked [m]. Places that cannot be seen count in neither.

    Places are points spread evenly by area and, for the largest, one close to each corner of each face. `behind` are
    the faces that nothing is seen through, the given ones or more; `within` [m], shape (2, 3), is the box whose places
    count: all three are 0 where there are none.
    """
    near = given if within is None else given.submesh(reaching_into(given, within))
    if len(near.faces) == 0:
        return 0.0, 0.0, 0.0
    area = float(near.face_areas.sum())
    count = int(np.clip(area / FINEST_SPACING**2, 100, MOST_PLACES))
    look = SurfaceVisibility(given, behind)
    even = in_sight(near, solid, look, within, spread(near, count))
    corner = in_sight(near, solid, look, within, corners(near), share=False)
    most = float(max(even.max(initial=0.0), corner.max(initial=0.0)))
    return most, float(even.mean()) if len(even) else 0.0, float(np.sqrt(area / count))


def in_sight(
    mesh: Mesh,
    solid: Mesh,
    look: "SurfaceVisibility",
    within: Array | None,
    places: tuple[Array, NDArray[np.int64]],
    *,
    share: bool = True,
) -> Array:
    """How far those of the places (points and their faces) in a box that can be seen lie off a solid's surface [m].

    Whether places that have not moved can be seen is only asked for the `share` of those that have, if there are any.
    """
    points, face = places
    if within is not None:
        inside = ((points >= within[0]) & (points <= within[1])).all(axis=1)
        points, face = points[inside], face[inside]
    distance = gaps(points, solid)
    kept = distance <= UNMOVED
    far, still = np.flatnonzero(~kept), np.flatnonzero(kept)
    kept[far] = look.sees(points[far], unit_normals(mesh, face[far]))
    if share and kept[far].any():
        kept[still] = look.sees(points[still], unit_normals(mesh, face[still]))
    return distance[kept]


def reaching_into(mesh: Mesh, box: Array) -> NDArray[np.int64]:
    """Faces whose own boxes meet a box [m], shape (2, 3)."""
    corner = mesh.triangles
    return np.flatnonzero(((corner.max(axis=1) >= box[0]) & (corner.min(axis=1) <= box[1])).all(axis=1))


def gaps(points: Array, solid: Mesh) -> Array:
    """Distance of points from a surface [m], shape (n,): in double precision where single says it is not nothing."""
    distance = MeshDistance(solid).unsigned(points)
    far = np.flatnonzero(distance > UNMOVED)
    if len(far):
        square = igl.point_mesh_squared_distance(points[far], solid.vertices, solid.faces.astype(np.int64))[0]
        distance[far] = np.sqrt(square)
    return distance


def corners(mesh: Mesh) -> tuple[Array, NDArray[np.int64]]:
    """A point close to each corner of each face [m], shape (3 m, 3), and its face."""
    weight = np.array([[0.98, 0.01, 0.01], [0.01, 0.98, 0.01], [0.01, 0.01, 0.98]])
    points = np.einsum("kc,nci->nki", weight, mesh.triangles).reshape(-1, 3)
    return points, np.repeat(np.arange(len(mesh.faces)), 3)


def unit_normals(mesh: Mesh, face: NDArray[np.int64]) -> Array:
    """Normals of faces, shape (n, 3)."""
    normal = mesh.face_normals[face]
    return np.asarray(normal / np.linalg.norm(normal, axis=1, keepdims=True))


class SurfaceVisibility:
    """Visibility of a thing's surface from outside, prepared for many places; made ready when it is first asked."""

    def __init__(self, given: Mesh, behind: Mesh | None = None) -> None:
        self._given = given
        self._behind = given if behind is None else behind

    @cached_property
    def _caster(self) -> Raycaster:
        return Raycaster(self._behind)

    @cached_property
    def _closed(self) -> MeshDistance | None:
        shells = [p for p in pieces_of(self._given) if is_closed(p)]
        return MeshDistance(Mesh.concatenate(shells)) if shells else None

    def sees(self, points: Array, normal: Array) -> NDArray[np.bool_]:
        """Whether points on faces can be seen, shape (n,)."""
        if len(points) == 0:
            return np.zeros(0, dtype=bool)
        visible = seen(self._caster, points, normal)
        if self._closed is not None:  # a shell that is closed leaves no doubt about what lies in it
            above, below = points + LIFT * normal, points - LIFT * normal
            visible &= ~(self._closed.inside(above) & self._closed.inside(below))
        return visible


def seen(caster: Raycaster, points: Array, normal: Array) -> NDArray[np.bool_]:
    """Whether points on faces can be seen from outside, shape (n,): some ways out of them meet nothing, and few run
    into the back of another face first. Those of a face inside another piece of the same thing do, and of one in a
    pocket between two layers none leads out.
    """
    free, out = np.zeros((2, len(points)))
    for direction in WAYS:
        ahead = np.sign(normal @ direction)[:, None]
        way = ahead * direction
        hit = caster.cast(points + LIFT * normal, way)
        missed = ~np.isfinite(hit.distance)
        out += missed
        free += missed | (np.einsum("ni,ni->n", hit.normal, way) <= 0.0)
    return (free > FREE * len(WAYS)) & (out > OPEN * len(WAYS))


def spread(mesh: Mesh, count: int) -> tuple[Array, NDArray[np.int64]]:
    """Points on the faces, evenly by area, always the same [m], shape (count, 3), and the face of each."""
    rng = np.random.default_rng(0)
    until = np.cumsum(mesh.face_areas)
    face = np.searchsorted(until, (np.arange(count) + rng.uniform(size=count)) * until[-1] / count)
    face = np.minimum(face, len(until) - 1)
    u, v = rng.uniform(size=(2, count))
    over = u + v > 1.0
    u, v = np.where(over, 1.0 - u, u), np.where(over, 1.0 - v, v)
    a, b, c = mesh.corners(face).transpose(1, 0, 2)
    return np.asarray(a + u[:, None] * (b - a) + v[:, None] * (c - a)), face
