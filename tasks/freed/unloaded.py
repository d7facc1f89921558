"""The scene without the dents of some things, and those things lifted to where they would begin to sink in.

A dent is elastic: the surface springs back once the thing in it is lifted off. So a drop in which that thing takes part
starts from the unloaded surface with the thing just above it, in its rest orientation, and it sinks in again.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dcap.geometry.deform import DisplacementField, with_own_vertices
from dcap.geometry.placement.clearance import Clearance
from dcap.geometry.raycast import Raycaster
from dcap.scene.types.earlier import Deformation
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.segmentation import Segmentation

Array = NDArray[np.float64]

GAP = 1e-3
"""Height over the surface below at which a lifted thing starts [m]: a tenth of the object's own."""
HIGHER = 5e-3
"""Height above all possible obstacles from which its way down is measured [m]."""
AROUND = 0.05
"""Distance in plan beyond which nothing is in a thing's way [m]."""


def unloaded(scene: Segmentation, deformations: Sequence[Deformation]) -> Segmentation:
    """The scene with the deformed surfaces in their unloaded shape."""
    vertices = scene.mesh.vertices.copy()
    for one in deformations:
        mine = np.unique(scene.mesh.faces[scene.face_instance == scene.index_of(one.instance)])
        low, high = one.surface.bounds
        near = mine[((vertices[mine] >= low - AROUND) & (vertices[mine] <= high + AROUND)).all(axis=1)]
        if len(near):
            vertices[near] -= DisplacementField(one.surface, one.shift).at(vertices[near])
    return replace(scene, mesh=replace(scene.mesh, vertices=vertices))


def lifted(scene: Segmentation, things: Sequence[str], most: float) -> tuple[Segmentation, dict[str, float]]:
    """The scene with each of the things `GAP` above everything below it, from the bottom up, and the lift of each [m];
    `most` is the largest possible depth in a dent [m]."""
    for one in things:
        scene = replace(scene, mesh=with_own_vertices(scene.mesh, scene.face_instance == scene.index_of(one)))
    vertices = scene.mesh.vertices.copy()
    heights: dict[str, float] = {}
    mesh_of = {one: scene.instance_mesh(scene.index_of(one)) for one in things}
    waiting = np.isin(scene.face_instance, [scene.index_of(one) for one in things])
    for one in bottom_up(mesh_of):
        index = scene.index_of(one)
        around = faces_around(Mesh(vertices, scene.mesh.faces, scene.mesh.colors), mesh_of[one], ~waiting)
        heights[one] = height_over(mesh_of[one], around, max(heights.values(), default=0.0) + most, GAP)
        mine = np.unique(scene.mesh.faces[scene.face_instance == index])
        vertices[mine, 2] += heights[one]
        waiting[scene.face_instance == index] = False
    return replace(scene, mesh=replace(scene.mesh, vertices=vertices)), heights


def bottom_up(mesh_of: dict[str, Mesh]) -> list[str]:
    """The things by the height of their middles: a thing on another one comes after it."""
    return sorted(mesh_of, key=lambda one: float(mesh_of[one].bounds[:, 2].mean()))


def faces_around(mesh: Mesh, thing: Mesh, allowed: NDArray[np.bool_]) -> Mesh:
    """The allowed faces (m,) that are near a thing in plan."""
    low, high = thing.bounds[0, :2] - AROUND, thing.bounds[1, :2] + AROUND
    faces = np.flatnonzero(allowed)
    corner = mesh.corners(faces)[:, :, :2]
    return mesh.submesh(faces[((corner.max(axis=1) >= low) & (corner.min(axis=1) <= high)).all(axis=1)])


def height_over(thing: Mesh, around: Mesh, most: float, gap: float) -> float:
    """Lift that brings a thing a gap [m] above everything below it, at most about `most` [m] more than that; never
    down."""
    if not len(around.faces):
        return 0.0
    start = most + HIGHER + gap
    way = Clearance(thing, around, Raycaster(around)).gap(np.array([0.0, 0.0, start]))
    return max(start + gap - way, 0.0) if np.isfinite(way) else 0.0
