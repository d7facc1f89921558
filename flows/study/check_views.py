"""Pictures of attention checks: by the cameras and the renderer that took the run's own, so that none is told apart.

In: the placement that a check is made of, and its surface at rest and as it is shown. Out: a picture for each of the
placement's own, of the same name and size. The overview is from the same camera; the close-up from the same direction
and distance, centred on the contact of what is shown, as another method's is. Walls before a camera are cut away where
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
from dcap.scene.types.judged_views import PLACED
from dcap.scene.types.paint import PaintedMesh
from dcap.scene.types.segmentation import Instance, Segmentation
from flows.judge_views import taken_from
from tasks.render.scene_views import SceneViews
from tasks.render.settled_meshes import structure_faces


def check_pictures(
    placement: ShownPlacement, settled: PlacedSurface, shown: PlacedSurface
) -> Mapping[str, NDArray[np.uint8]]:
    """The pictures of one side of a check by name, sRGB; FormatError where scene.json is none, InputError where it is
    not known from where the placement's own were taken."""
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
    """What the things of a placement's scene are; empty where it does not say."""
    return tuple(map(instance_of, read_facts(folder).instances)) if (folder / FACTS).is_file() else ()


def contact_of(surface: PlacedSurface, things: tuple[Instance, ...], toward: Direction) -> NDArray[np.float64]:
    """Where the object touches, or is nearest to what is below, as seen from a direction [m], shape (3,)."""
    scene, thing = parts_of(surface)
    structure = structure_faces(segmented(scene, things)) if things else np.zeros(len(scene.mesh.faces), dtype=bool)
    return PlacedThing.of(scene.mesh, structure, thing.mesh).contact_seen(toward, Raycaster(thing.mesh))[1]


def surface_views(surface: PlacedSurface, things: tuple[Instance, ...]) -> SceneViews | PreparedMeshes:
    """What cameras see of a placement: what is cut away depends on the camera where it is known what walls are."""
    scene, thing = parts_of(surface)
    look, own = (PaintedMesh(one.mesh, one.paint) for one in (scene, thing))
    return SceneViews(segmented(scene, things), look, [own]) if things else PreparedMeshes([look, own])


def parts_of(surface: PlacedSurface) -> tuple[PlacedSurface, PlacedSurface]:
    """The scene and the object."""
    return surface.of(np.flatnonzero(~surface.is_thing)), surface.of(np.flatnonzero(surface.is_thing))


def segmented(scene: PlacedSurface, things: tuple[Instance, ...]) -> Segmentation:
    """The scene with whose each face is."""
    index = {one.id: number for number, one in enumerate(things)}
    number_of = np.array([*(index.get(name, -1) for name in scene.ids), -1], dtype=np.int32)
    owner = number_of[scene.face_id]
    return Segmentation(scene.mesh, things, owner, np.full_like(owner, -1))
