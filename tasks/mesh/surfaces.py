"""The textured surface of a scene's or an object's source, beside the coloured mesh that the stages compute on.

In: the source and the scan that was made of it. Out: its faces, corners and textures as the file has them, in metres
and z up; nothing where the file has no textures.
"""

from dcap.scene.readers.source import read_surface
from dcap.scene.store.artifacts import Source
from dcap.scene.types.paint import SourceSurface
from dcap.scene.types.scan import Scan
from tasks.runner.stage import stage


def surface_scene(source: Source, scan: Scan) -> SourceSurface:
    """The scene's textured surface."""
    return read_surface(source.path, scan.world_from_file)


def surface_object(source: Source, scan: Scan) -> SourceSurface:
    """The object's textured surface."""
    return read_surface(source.path, scan.world_from_file)


surface_scene_task = stage(surface_scene)
surface_object_task = stage(surface_object)
