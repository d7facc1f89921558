"""Pictures of attention checks, by the cameras and the renderer of the run's own, so that they look the same.

In: the placement that a check is made from, and its surface at rest and as shown. Out: a picture for each of the
placement's own, with the same name and size. The overview is from the same camera; the close-up from the same direction
and distance, centred on the contact that is shown, as for other methods. Walls in front of a camera are cut away if
the placement says which things are walls (scene.json).
"""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dcap.evaluation.judging.cameras import CLOSEUPS, SAMPLES, Direction, PlacedThing, camera_of
from dcap.evaluation.study.placed_surface import PlacedSurface
from dcap.evaluation.study.placements import ShownPlacement
from dcap.geometry.raycast import Raycaster
from dcap.geometry.rendering.picture import picture
from dcap.geometry.rendering.surface import PreparedMeshes
from dcap.scene.readers.scenes.placed_scene import FACTS, instance_of, read_facts
from dcap.scene.types.mesh import PaintedMesh
from dcap.scene.types.pictures import PLACED
from dcap.scene.types.segmentation import Instance, Segmentation
from flows.judge_views import taken_from
from tasks.render.settled_meshes import structure_faces
from tasks.render.views import SceneViews


def check_pictures(
    placement: ShownPlacement, settled: PlacedSurface, shown: PlacedSurface
) -> Mapping[str, NDArray[np.uint8]]:
    """The pictures of one side of a check by name, sRGB; FormatError for an invalid scene.json, InputError if the
    cameras of the placement's own pictures are not known."""
    views, taken = surface_views(shown, things_of(placement.folder)), taken_from(placement.folder)
    contact = np.array(taken.contact)
    if not np.array_equal(shown.thing_bounds, settled.thing_bounds):
        contact = contact_of(shown, things_of(placement.folder), CLOSEUPS[taken.cameras.direction])
    found = {}
    for name, view in zip(PLACED, (taken.cameras.overview, taken.cameras.closeup_at(contact)), strict=True):
        camera = camera_of(view)
        meshes = views.seen_by(camera) if isinstance(views, SceneViews) else views
        found[name] = picture(meshes, camera, samples=SAMPLES).rgb
    return found


def things_of(folder: Path) -> tuple[Instance, ...]:
    """Things of a placement's scene from its scene.json; empty without one."""
    return tuple(map(instance_of, read_facts(folder).instances)) if (folder / FACTS).is_file() else ()


def contact_of(surface: PlacedSurface, things: tuple[Instance, ...], toward: Direction) -> NDArray[np.float64]:
    """Point where the object touches the scene below, or is nearest to it, seen from a direction [m], shape (3,)."""
    scene, thing = parts_of(surface)
    structure = structure_faces(segmented(scene, things)) if things else np.zeros(len(scene.mesh.faces), dtype=bool)
    return PlacedThing.of(scene.mesh, structure, thing.mesh).contact_seen(toward, Raycaster(thing.mesh))[1]


def surface_views(surface: PlacedSurface, things: tuple[Instance, ...]) -> SceneViews | PreparedMeshes:
    """Meshes that cameras see of a placement; if the walls are known, those in front of each camera are cut away."""
    scene, thing = parts_of(surface)
    look, own = (PaintedMesh(one.mesh, one.paint) for one in (scene, thing))
    return SceneViews(segmented(scene, things), look, [own]) if things else PreparedMeshes([look, own])


def parts_of(surface: PlacedSurface) -> tuple[PlacedSurface, PlacedSurface]:
    """The scene and the object."""
    return surface.of(np.flatnonzero(~surface.is_thing)), surface.of(np.flatnonzero(surface.is_thing))


def segmented(scene: PlacedSurface, things: tuple[Instance, ...]) -> Segmentation:
    """The scene with the instance of each face."""
    index = {one.id: number for number, one in enumerate(things)}
    number_of = np.array([*(index.get(name, -1) for name in scene.ids), -1], dtype=np.int32)
    owner = number_of[scene.face_id]
    return Segmentation(scene.mesh, things, owner, np.full_like(owner, -1))
