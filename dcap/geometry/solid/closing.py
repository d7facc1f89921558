"""Ways to close an open surface: flat caps on its holes, walls down to a floor, a thickness for a sheet.

In: cleaned faces of one connected piece (`cleaning.py` next to this). Out: the piece with the faces that close it;
given faces stay where they are. Whether the result is a good solid is for the caller to measure.
"""

import manifold3d
import numpy as np
from numpy.typing import NDArray

from dcap.arrays import Array, IntArray
from dcap.geometry.pieces import boundary_edges, hole_loops
from dcap.geometry.raycast import Raycaster
from dcap.geometry.solid.repair_log import RepairKind, RepairLog
from dcap.scene.types.mesh import Mesh

UPRIGHT = 0.5  # borders whose plane is steeper than 60 degrees lie in a side
SMALL = 0.1  # share of a piece's plan below which a hole in its underside is capped, not continued downwards
SLENDER = 0.1  # thickness over size that a small sheet is given at most
OUTWARDS = 0.5  # least cosine between a ray and the normal of a face through which it comes out
TOWARDS = 0.75  # share of the way to what lies behind a sheet that it is thickened at most: both sides overlap
SKIN = 1e-5  # where rays behind a sheet begin: they do not hit the sheet itself [m]
LEAST_SLAB = 1e-4  # thickness of a sheet that lies on another [m]
BELOW = 1e-3  # a floor is at least this far [m] below the border that walls come down from: no wall without height


def perimeter(points: Array) -> float:
    """Length of a closed chain of points (n, 3) [m]."""
    return float(np.linalg.norm(points - np.roll(points, -1, axis=0), axis=1).sum())


def area_vector(points: Array) -> Array:
    """Area of a closed chain of points (n, 3) times its normal [m^2], shape (3,) (Newell)."""
    arm = points - points.mean(axis=0)
    return np.asarray(0.5 * np.cross(arm, np.roll(arm, -1, axis=0)).sum(axis=0))


def cap(points: Array) -> IntArray:
    """Triangles that close a hole, as indices (k, 3) of its border (n, 3), which runs as the faces around it do.

    They pass the border against its direction. The border is triangulated in the plane that it fills best.
    """
    back = points[::-1]
    normal = area_vector(back)
    length = float(np.linalg.norm(normal))
    if len(points) < 3 or length == 0.0:
        return np.zeros((0, 3), dtype=np.int64)
    across = np.cross(normal / length, np.eye(3)[int(np.argmin(np.abs(normal)))])
    across /= np.linalg.norm(across)
    plane = np.stack([across, np.cross(normal / length, across)])
    found = manifold3d.triangulate([np.ascontiguousarray((back - points.mean(axis=0)) @ plane.T)])
    return len(points) - 1 - np.asarray(found, dtype=np.int64).reshape(-1, 3)


def capped(mesh: Mesh, loops: list[IntArray], log: RepairLog) -> Mesh:
    """The mesh with the given holes closed by flat caps."""
    if not loops:
        return mesh
    caps = [loop[cap(mesh.vertices[loop])] for loop in loops]
    for loop in loops:
        log.add(RepairKind.CAPPED, perimeter(mesh.vertices[loop]))
    return Mesh(mesh.vertices, np.concatenate([mesh.faces, *caps]).astype(np.int32), mesh.colors)


def borders(mesh: Mesh) -> tuple[list[IntArray], list[IntArray]]:
    """Where a surface ends below, and its other holes, as chains of vertices.

    A border that runs counter-clockwise seen from above has nothing under it. One in a side of a thing, or much smaller
    than its plan, is a hole.
    """
    plan = float(np.prod(np.ptp(mesh.bounds, axis=0)[:2]))
    below: list[IntArray] = []
    holes: list[IntArray] = []
    for loop in hole_loops(mesh):
        area = area_vector(mesh.vertices[loop])
        down = area[2] > max(UPRIGHT * float(np.linalg.norm(area)), SMALL * plan)
        (below if down else holes).append(loop)
    return below, holes


def walled(mesh: Mesh, loops: list[IntArray], floor: float, log: RepairLog) -> Mesh:
    """The mesh with walls from the given borders straight down to `floor` [m] and flat bottoms there."""
    vertices, colors = [mesh.vertices], [mesh.colors]
    faces: list[NDArray[np.integer]] = [mesh.faces]
    count = len(mesh.vertices)
    for loop in loops:
        low = mesh.vertices[loop]
        low[:, 2] = min(floor, float(low[:, 2].min()) - BELOW)
        under: IntArray = count + np.arange(len(loop), dtype=np.int64)
        onward, under_onward = np.roll(loop, -1), np.roll(under, -1)
        faces += [np.stack(c, axis=1) for c in ((onward, loop, under), (onward, under, under_onward))]
        faces.append(under[cap(low)])
        vertices.append(low)
        colors.append(mesh.colors[loop])
        count += len(loop)
        log.add(RepairKind.WALLED, perimeter(mesh.vertices[loop]))
    return Mesh(np.concatenate(vertices), np.concatenate(faces).astype(np.int32), np.concatenate(colors))


def room_behind(mesh: Mesh, raycaster: Raycaster) -> Array:
    """How thick a sheet may become at each vertex and not come out of a face behind it [m], shape (n,): of a face that
    it would pass from inside, as the top of a board; what it would run into is united with it."""
    behind = -mesh.vertex_normals
    hits = raycaster.cast(mesh.vertices + SKIN * behind, behind)
    outwards = np.einsum("ij,ij->i", hits.normal, behind) > OUTWARDS
    distance = np.where(outwards, hits.distance + SKIN, np.inf)
    least = distance.copy()  # of a vertex and its neighbours: the second side of a face is flat between its corners
    np.minimum.at(least, mesh.faces, distance[mesh.faces].min(axis=1, keepdims=True))
    return np.maximum(TOWARDS * least, LEAST_SLAB)


def slab(mesh: Mesh, thickness: float | Array, log: RepairLog) -> Mesh:
    """A sheet with a second side behind it, against its normals, and walls along its border: `thickness` [m], one or
    shape (n,), or, if it is small, a share of its size.
    """
    most = SLENDER * float(np.sqrt(mesh.face_areas.sum()))
    depth = np.broadcast_to(np.minimum(thickness, most), len(mesh.vertices))
    edge, _ = boundary_edges(mesh)
    start, end = edge.T
    count = len(mesh.vertices)
    walls = [np.stack(c, axis=1) for c in ((end, start, start + count), (end, start + count, end + count))]
    log.add(RepairKind.THICKENED, float(depth.max()))
    return Mesh(
        np.concatenate([mesh.vertices, mesh.vertices - depth[:, None] * mesh.vertex_normals]),
        np.concatenate([mesh.faces, mesh.faces[:, ::-1] + count, *walls]).astype(np.int32),
        np.concatenate([mesh.colors, mesh.colors]),
    )
