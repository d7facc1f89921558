"""Surfaces as convex prisms, which collide at the surface itself: dents, rims and hollows keep their shape.

MuJoCo collides a mesh as its convex hull. A prism reaches from a triangle into the solid, against the triangle's normal
and as deep as the solid allows; together the prisms have the solid's surface. Near the contact, surfaces are kept to
0.05 mm if the number of faces allows it; farther away, objects only fall, and surfaces are coarse.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dcap.arrays import Array, Mask
from dcap.geometry.pieces import is_closed, outward, welded
from dcap.geometry.raycast import Raycaster
from dcap.geometry.solid.height_map import seen_from_above
from dcap.geometry.solid.mending import look_spacing, looks_at_backs, wound_outwards
from dcap.geometry.solid.surface_prisms import RIM, ThinnedSurface, rays_in, samples, thinned
from dcap.scene.types.mesh import Mesh

NEAR = 0.02
"""Distance between surfaces within which they keep their detail [m]."""
ASIDE, ABOVE = 2.0, 0.1
"""Distance to the sides and above the object within which the scene is used [m]; below, all of it is. In one second an
object slides 1.3 m down 40 degrees with friction 0.5."""
DEEPEST, SHEET = 0.1, 2e-3
"""Largest depth of a prism [m], so that a body in it is pushed out on the right side; depth for an object's sheet
[m]."""
THROUGH, LEAST = 0.45, 2e-4
"""Largest depth of a prism as a share of the solid's thickness [-], so that opposite prisms do not meet; least depth
[m]."""
THIN = 2e-3
"""Thickness of a scene below which only the side that faces the object has prisms, of full depth [m]."""
NARROW = 1e-5
"""Height of a face below which it has no prism [m]; the gap that it leaves is as narrow."""
START = 2e-5
"""Start of a ray beneath its face [m]."""


FINE, FINE_BUDGETS = 5e-5, (4000, 2000, 1000, 500, 250)
"""Largest distance of near surfaces from their collision shapes [m], and numbers of faces: the smallest that keeps this
distance, else the first. Surfaces with fewer faces are not changed."""
FAR_VERTICES, FAR_CELL, CLEAR = (100, 400, 1600), 0.5 * NEAR, 0.25 * NEAR
"""Numbers of vertices of far surfaces, the cell of their first simplification [m], and their least distance from the
other body [m]: the smallest number that keeps it, else all. A body that falls on them is no longer at rest."""


@dataclass(frozen=True, eq=False, slots=True)
class Prisms:
    """Convex shapes of six corners."""

    corners: Array
    """[m], shape (n, 6, 3)."""
    owner: NDArray[np.int64]
    """Index of each prism's thing, shape (n,)."""
    deviation: float
    """Largest distance from the surface near the contact [m]."""


def scene_prisms(scene: Mesh, owner: NDArray[np.int64], thing: Mesh) -> Prisms:
    """The part of a scene that an object may touch or fall on within a second."""
    low, high = thing.bounds + np.array([[-ASIDE, -ASIDE, -np.inf], [ASIDE, ASIDE, ABOVE]])
    reached = within(scene.triangles, low, high)
    center = thing.bounds.mean(axis=0)
    found, owners, deviation = [np.zeros((0, 6, 3))], [np.zeros(0, dtype=np.int64)], 0.0
    for index in np.unique(owner[reached]):
        mine = np.flatnonzero(owner == index)
        whole = wound(scene.submesh(mine))
        seen = reached[mine] & ~(doubled(whole) & looks_away(whole, center))
        near = close_to(whole, thing)
        for few in (kept(whole, near & seen), coarse(whole, ~near & seen, thing)):
            unit, broad, thickness = under(few.mesh, whole)
            thin = thickness < THIN
            broad &= ~(thin & looks_away(few.mesh, center))
            depth = np.where(thin, DEEPEST, np.minimum(THROUGH * thickness, DEEPEST))
            found.append(sunk(few.mesh.triangles, unit, depth)[broad])
            owners.append(np.full(int(broad.sum()), index))
            deviation = max(deviation, few.deviation)
    return Prisms(np.concatenate(found), np.concatenate(owners), deviation)


def object_prisms(thing: Mesh, scene: Mesh) -> Prisms:
    """Prisms of an object; they may be as thin as sheets, because those of the scene are thick."""
    whole = wound(thing)
    surroundings = around(scene, thing.bounds, NEAR)
    near, sheet = close_to(whole, surroundings), doubled(whole)
    found, deviation = [], 0.0
    for flat in (False, True):
        for few in (kept(whole, near & (sheet == flat)), coarse(whole, ~near & (sheet == flat), surroundings)):
            unit, broad, thickness = under(few.mesh, whole)
            solid = np.clip(THROUGH * thickness, LEAST, DEEPEST)
            depth = np.where(np.isfinite(thickness), LEAST if flat else solid, SHEET)
            found.append(sunk(few.mesh.triangles, unit, depth)[broad])
            deviation = max(deviation, few.deviation)
    corners = np.concatenate(found)
    return Prisms(corners, np.zeros(len(corners), dtype=np.int64), deviation)


def kept(mesh: Mesh, mask: Mask) -> ThinnedSurface:
    """Some faces (m,) of a mesh unchanged, or fewer faces of the same shape if they are many."""
    some = mesh.submesh(np.flatnonzero(mask))
    return thinned(some, FINE, FINE_BUDGETS) if len(some.faces) > FINE_BUDGETS[-1] else ThinnedSurface(some, 0.0)


def coarse(mesh: Mesh, mask: Mask, other: Mesh) -> ThinnedSurface:
    """Some faces (m,) of a mesh, not NEAR the other one, simplified as far as they stay clear of it; their deviation
    does not count."""
    import open3d

    some = mesh.submesh(np.flatnonzero(mask))
    if len(some.vertices) <= FAR_VERTICES[0]:
        return ThinnedSurface(some, 0.0)
    points = samples(other)
    dense = open3d.geometry.TriangleMesh(
        open3d.utility.Vector3dVector(some.vertices), open3d.utility.Vector3iVector(some.faces)
    )
    merged = dense.simplify_vertex_clustering(FAR_CELL)  # collapsing the edges of a large flat surface takes minutes
    for count in FAR_VERTICES:
        few = merged.simplify_quadric_decimation(2 * count, boundary_weight=RIM)
        found = Mesh.of(np.asarray(few.vertices), np.asarray(few.triangles))
        if Raycaster(found).distance_to(points).min(initial=np.inf) > CLEAR:
            return ThinnedSurface(found, 0.0)
    return ThinnedSurface(some, 0.0)


def sunk(corner: Array, unit: Array, depth: Array) -> Array:
    """Prisms of triangles (n, 3, 3) and outward unit normals (n, 3), shape (n, 6, 3)."""
    return np.concatenate([corner, corner - (depth[:, None] * unit)[:, None]], axis=1)


def under(few: Mesh, solid: Mesh) -> tuple[Array, Mask, Array]:
    """Outward unit normals of faces, whether each is broad enough, and the thickness of the solid under each [m], inf
    for a sheet."""
    corner, normal = few.triangles, few.face_normals
    length = np.linalg.norm(normal, axis=1)
    longest = np.linalg.norm(corner - np.roll(corner, 1, axis=1), axis=2).max(axis=1, initial=0.0)
    broad = length > NARROW * longest
    unit = np.zeros_like(normal)
    unit[broad] = normal[broad] / length[broad, None]
    starts, ways = rays_in(corner, unit, START)
    distance = Raycaster(solid).cast(starts, ways).distance.reshape(len(corner), 4).min(axis=1)
    return unit, broad, np.asarray(distance, dtype=np.float64)


def within(corner: Array, low: Array, high: Array) -> Mask:
    """Whether the boxes of triangles (n, 3, 3) meet another box, shape (n,)."""
    return np.asarray(((corner.max(axis=1) >= low) & (corner.min(axis=1) <= high)).all(axis=1))


def around(mesh: Mesh, bounds: Array, reach: float) -> Mesh:
    """Faces of a mesh that may be within `reach` of a box [m]."""
    return mesh.submesh(np.flatnonzero(within(mesh.triangles, bounds[0] - reach, bounds[1] + reach)))


def close_to(mesh: Mesh, other: Mesh) -> Mask:
    """Whether faces of a mesh may be NEAR another mesh, shape (m,)."""
    if not len(other.faces):
        return np.zeros(len(mesh.faces), dtype=bool)
    corner = mesh.triangles
    found = within(corner, other.bounds[0] - NEAR, other.bounds[1] + NEAR)
    asked = np.flatnonzero(found)
    middle = corner[asked].mean(axis=1)
    radius = np.linalg.norm(corner[asked] - middle[:, None], axis=2).max(axis=1, initial=0.0)
    found[asked] = Raycaster(other).distance_to(middle) <= NEAR + radius
    return found


def wound(mesh: Mesh) -> Mesh:
    """A thing with faces wound outwards: by its pieces' volumes if it is closed, else (a scan) by the view from above,
    as in the drop."""
    if is_closed(mesh):
        return outward(mesh)
    caster = Raycaster(mesh)
    seen = seen_from_above(caster, mesh.bounds, look_spacing(mesh.bounds))
    faces = wound_outwards(mesh, caster, seen)[0] if looks_at_backs(mesh, seen) else mesh.faces
    return Mesh(mesh.vertices, faces, mesh.colors)


def doubled(mesh: Mesh) -> Mask:
    """Whether another face has the same corners, as in two-sided sheets, shape (m,)."""
    corners = np.sort(welded(mesh.vertices)[mesh.faces], axis=1)
    _, same, count = np.unique(corners, axis=0, return_inverse=True, return_counts=True)
    return np.asarray(count[same.reshape(-1)] > 1)


def looks_away(mesh: Mesh, point: Array) -> Mask:
    """Whether faces look away from a point [m], shape (m,)."""
    return np.asarray(np.einsum("ij,ij->i", mesh.face_normals, point - mesh.triangles.mean(axis=1)) < 0.0)
