"""Pictures of attention checks: by the cameras and the renderer that took the run's own, so that none is told apart.

In: the placement that a check is made of, and its surface at rest and as it is shown. Out: a picture for each of the
placement's own, of the same name and size. What shows the object is centred on it where it is shown; what shows the
place is the same camera for both sides, as it is for two methods. Walls before a camera are cut away where the
placement says which things are walls (scene.json).
"""

import json
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from dcap.evaluation.study.placed_surface import PlacedSurface
from dcap.evaluation.study.placements import ShownPlacement
from dcap.geometry.camera import looking_at
from dcap.geometry.rendering.picture import picture
from dcap.geometry.rendering.surface import PreparedMeshes
from dcap.scene.readers.files.image import check_size
from dcap.scene.readers.scenes.placed_scene import FACTS, instance_of, read_facts
from dcap.scene.types.paint import PaintedMesh
from dcap.scene.types.segmentation import Instance, Segmentation
from flows.find_run import RUN
from tasks.measure.judge_cameras import JudgeCameras, ViewsConfig
from tasks.render.scene_views import SceneViews

PLACEMENT = "placement.json"


def check_pictures(
    placement: ShownPlacement, settled: PlacedSurface, shown: PlacedSurface, config: ViewsConfig
) -> Mapping[str, NDArray[np.uint8]]:
    """The pictures of one side of a check by name, sRGB; FormatError where scene.json is none."""
    views = surface_views(shown, things_of(placement.folder))
    cameras, found = cameras_of(placement, settled, config), {}
    for path in placement.pictures:
        one = cameras.of(path.stem, np.mean(shown.thing_bounds, axis=0))
        camera = looking_at(one.position, one.target, *size_of(path), fov_deg=config.fov_deg)
        meshes = views.seen_by(camera) if isinstance(views, SceneViews) else views
        found[path.stem] = picture(meshes, camera, samples=config.samples).rgb
    return found


def views_config(run: Path) -> ViewsConfig:
    """How the pictures of the run in a folder were taken."""
    known = json.loads((run / RUN).read_text(encoding="utf-8")).get("config", {}).get("views", {})
    return ViewsConfig.model_validate({name: one for name, one in known.items() if name in ViewsConfig.model_fields})


def size_of(path: Path) -> tuple[int, int]:
    """Width and height of a picture [pixel]; FormatError where one of that size would not be read: it is drawn anew."""
    with Image.open(path, formats=("PNG",)) as one:
        check_size(one.size, str(path))
        return one.size


def things_of(folder: Path) -> tuple[Instance, ...]:
    """What the things of a placement's scene are; empty where it does not say."""
    return tuple(map(instance_of, read_facts(folder).instances)) if (folder / FACTS).is_file() else ()


def surface_views(surface: PlacedSurface, things: tuple[Instance, ...]) -> SceneViews | PreparedMeshes:
    """What cameras see of a placement: what is cut away depends on the camera where it is known what walls are."""
    scene, thing = (surface.of(np.flatnonzero(own)) for own in (~surface.is_thing, surface.is_thing))
    parts = [PaintedMesh(one.mesh, one.paint) for one in (scene, thing)]
    if not things:
        return PreparedMeshes(parts)
    index = {one.id: number for number, one in enumerate(things)}
    number_of = np.array([*(index.get(name, -1) for name in scene.ids), -1], dtype=np.int32)
    owner = number_of[scene.face_id]
    return SceneViews(Segmentation(scene.mesh, things, owner, np.full_like(owner, -1)), parts[0], [parts[1]])


def cameras_of(placement: ShownPlacement, settled: PlacedSurface, config: ViewsConfig) -> JudgeCameras:
    """The cameras of the placement's own pictures."""
    scene = settled.of(np.flatnonzero(~settled.is_thing)).mesh
    base = json.loads((placement.folder / PLACEMENT).read_text(encoding="utf-8")).get("base") or {}
    box = next((one.box for one in things_of(placement.folder) if one.id == base.get("id")), None)
    low, high = scene.bounds
    center, diagonal = (box.center, box.diagonal) if box else (0.5 * (low + high), float(np.linalg.norm(high - low)))
    size = float(np.linalg.norm(np.ptp(np.asarray(settled.thing_bounds), axis=0)))
    return JudgeCameras(center, diagonal, 0.5 * (low + high), size, config)
