"""A surface as few triangles and as convex prisms under them: a collision shape that keeps dents as they are.

In: the settled surface near an object. Out: the same surface with far fewer faces, never farther from it than a
tolerance where the budget allows, and a prism of each face, sunk into the solid against the face's normal.
"""

from dataclasses import dataclass

import numpy as np

from dcap.arrays import Array
from dcap.geometry.distance import MeshDistance
from dcap.geometry.pieces import WELD
from dcap.geometry.raycast import Raycaster
from dcap.geometry.solid.convex_pieces import convex_hull
from dcap.scene.types.mesh import Mesh

TOLERANCE = 1e-4  # largest distance of the two surfaces [m]: a fifth of a millimetre is what contacts are off by anyway
BUDGETS = (4000, 2000, 1000, 500, 250)  # faces; the least that keeps the tolerance is taken, else the first
RIM = 10.0  # weight of border edges as faces are merged: borders stay where they are
DEPTH = 0.03  # of a prism [m]: what is inside it is pushed out on the right side
THROUGH = 0.45  # of the solid's thickness there at most [-]: the two sides of a board do not meet
THINNEST = 1e-3  # least depth of a prism [m]
NARROW = 1e-5  # faces narrower than this [m] have no prism; the crack that they leave is as narrow
OFF = 1e-4  # start of a ray beneath its face [m]
FOLDED = 5e-4  # a point THINNEST under a face that is this deep in what rests on it [m]: bodies at rest overlap by less
CORNER = 0.9  # where near a corner the thickness is measured, from the middle to the corner [-]


@dataclass(frozen=True, eq=False, slots=True)
class ThinnedSurface:
    """A surface with fewer faces."""

    mesh: Mesh
    deviation: float
    """Largest distance between the two, of vertices and middles of either from the other [m]."""


def thinned(mesh: Mesh, tolerance: float = TOLERANCE, budgets: tuple[int, ...] = BUDGETS) -> ThinnedSurface:
    """The surface with as few faces as the tolerance [m] allows, but at most the first budget."""
    import open3d

    shift = mesh.bounds.mean(axis=0)
    dense = open3d.geometry.TriangleMesh(
        open3d.utility.Vector3dVector(mesh.vertices - shift), open3d.utility.Vector3iVector(mesh.faces)
    )
    dense.merge_close_vertices(WELD)
    given, wanted = Raycaster(mesh), samples(mesh)
    found = ThinnedSurface(mesh, 0.0)
    for budget in budgets:
        if budget >= len(mesh.faces):
            continue
        dense = dense.simplify_quadric_decimation(budget, boundary_weight=RIM)
        few = Mesh.of(np.asarray(dense.vertices) + shift, np.asarray(dense.triangles))
        there = Raycaster(few).distance_to(wanted).max(initial=0.0)
        back = given.distance_to(samples(few)).max(initial=0.0)
        deviation = float(max(there, back))
        if deviation > tolerance and len(found.mesh.faces) <= budgets[0]:
            break
        found = ThinnedSurface(few, deviation)
    return found


def samples(mesh: Mesh) -> Array:
    """Vertices in use and middles of faces [m], shape (n, 3)."""
    return np.concatenate([mesh.vertices[np.unique(mesh.faces)], mesh.triangles.mean(axis=1)])


def prisms(mesh: Mesh, solid: Mesh, depth: float = DEPTH, free: Mesh | None = None) -> list[Mesh | None]:
    """A convex prism under each face, at most `depth` [m] deep, less where `solid`, the whole surface, is thin or where
    the prism would come out into `free`, what rests on the surface; None for a sliver."""
    corner = mesh.triangles
    normal = mesh.face_normals
    length = np.linalg.norm(normal, axis=1)
    longest = np.linalg.norm(corner - np.roll(corner, 1, axis=1), axis=2).max(axis=1)
    broad = length > NARROW * longest
    unit = np.zeros_like(normal)
    unit[broad] = normal[broad] / length[broad, None]
    deep = depths(corner, unit, solid, depth)
    if free is not None:
        room = free_depths(corner, unit, free)
        deep, broad = np.minimum(deep, room), broad & (room > 0.0)
    return [
        convex_hull(np.concatenate([one, one - down * n])) if wide else None
        for one, n, down, wide in zip(corner, unit, deep, broad, strict=True)
    ]


def depths(corner: Array, unit: Array, solid: Mesh, depth: float) -> Array:
    """How deep a prism under each triangle (n, 3, 3) with unit normals (n, 3) may be [m], shape (n,)."""
    starts, ways = rays_in(corner, unit, OFF)
    distance = Raycaster(solid).cast(starts, ways).distance.reshape(len(corner), -1).min(axis=1)
    return np.asarray(np.clip(THROUGH * distance, THINNEST, depth))


def free_depths(corner: Array, unit: Array, free: Mesh) -> Array:
    """How deep a prism may be before it enters a solid from outside [m], shape (n,); contact with it at the face itself
    does not count. 0 for a face that looks away from the solid it touches: a fold of a crease."""
    starts, ways = rays_in(corner, unit, THINNEST)
    hits = Raycaster(free).cast(starts, ways)
    entered = np.einsum("ij,ij->i", hits.normal, ways) < 0.0
    distance = np.where(entered, hits.distance, np.inf).reshape(len(corner), -1).min(axis=1)
    folded = (MeshDistance(free)(starts).reshape(len(corner), -1) < -FOLDED).any(axis=1)
    return np.asarray(np.where(folded, 0.0, np.maximum(THROUGH * distance, THINNEST)))


def rays_in(corner: Array, unit: Array, off: float) -> tuple[Array, Array]:
    """Rays from `off` [m] under the middle of each triangle and near its corners, down: origins and directions, shape
    (4 n, 3) each."""
    middle = corner.mean(axis=1, keepdims=True)
    starts = np.concatenate([middle, middle + CORNER * (corner - middle)], axis=1) - off * unit[:, None]
    ways = np.repeat(-unit, starts.shape[1], axis=0)
    return starts.reshape(-1, 3), np.where(np.abs(ways).sum(axis=1, keepdims=True) > 0.0, ways, [0.0, 0.0, -1.0])
