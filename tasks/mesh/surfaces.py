"""The textured surface of a scene's or an object's source, in addition to the coloured mesh of the stages.

In: the source and its scan. Out: faces, corners and textures of the file, in metres and z up; None without textures.
"""

from dataclasses import replace

import numpy as np

from dcap.geometry.deform import DisplacementField
from dcap.geometry.rendering.painted import nearest_faces
from dcap.scene.readers.source import read_surface
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.paint import SourceSurface
from dcap.scene.types.scan import Scan
from dcap.scene.types.segmentation import SegmentedScene
from tasks.artifact import Source
from tasks.cache import stage


def surface_scene(source: Source, scan: Scan) -> SourceSurface:
    """The scene's textured surface."""
    return read_surface(source.path, scan.world_from_file)


def surface_object(source: Source, scan: Scan) -> SourceSurface:
    """The object's textured surface."""
    return read_surface(source.path, scan.world_from_file)


def surface_start(surface: SourceSurface, given: SegmentedScene, start: SegmentedScene) -> SourceSurface:
    """The textured surface of an input scene at the start of the drop: dents undone, things lifted out of them.

    `given` and `start` have the same faces in the same order. What moved takes its part of the surface along.
    """
    corners, moved = given.mesh.triangles, start.mesh.triangles - given.mesh.triangles
    changed = np.unique(given.face_instance[np.abs(moved).max(axis=(1, 2)) > 0.0])
    if not surface.kept or not len(changed):
        return surface
    owner = nearest_faces(given.mesh, surface.mesh)
    instance = np.where(owner >= 0, given.face_instance[owner], -1)
    vertices = surface.mesh.vertices.copy()
    for one in changed[changed >= 0]:
        mine = given.face_instance == one
        faces = np.arange(3 * int(mine.sum()), dtype=np.int32).reshape(-1, 3)
        apart = Mesh.of(corners[mine].reshape(-1, 3), faces)
        used = np.unique(surface.mesh.faces[instance == one])
        field = DisplacementField(apart, moved[mine].reshape(-1, 3), close=np.inf)
        vertices[used] += field.at(vertices[used])
    return replace(surface, mesh=replace(surface.mesh, vertices=vertices))


surface_start_task = stage(surface_start)
surface_scene_task = stage(surface_scene)
surface_object_task = stage(surface_object)
