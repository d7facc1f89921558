"""The drop as a film: the object coming down and the dent forming, frame by frame.

In: scene and object as segmented, the settled state with its frames, and a camera. Out: pictures.
"""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dcap.geometry.camera import Camera
from dcap.geometry.rendering.painted import painted
from dcap.geometry.rendering.surface import PreparedMeshes
from dcap.scene.types.anchor import Anchor
from dcap.scene.types.paint import SourceSurface
from dcap.scene.types.segmentation import Segmentation
from dcap.scene.types.settled import Settled
from tasks.render.config import RenderConfig
from tasks.render.motion import DropMotion, MovingPoints, MovingScene
from tasks.render.settled_meshes import shown
from tasks.render.stage import photograph

MOST_PICTURES = 60
"""Number of pictures of a drop [-]: three seconds of film, including the held last picture."""


def drop_pictures(
    scene: Segmentation,
    item: Segmentation,
    anchor: Anchor,
    settled: Settled,
    surfaces: tuple[SourceSurface, SourceSurface],
    camera: Camera,
    config: RenderConfig,
) -> Iterator[NDArray[np.uint8]]:
    """The pictures of a drop, one after the other; `surfaces` are the textures of scene and object."""
    motion = DropMotion(settled)
    around, thing = MovingScene(scene, motion, anchor.base_id), item.mesh.transformed(anchor.world_from_object)
    points = MovingPoints.of_body(motion, 0, thing.vertices)
    look, own = painted(around.scene.mesh, surfaces[0]), painted(item.mesh, surfaces[1])
    for frame in motion.chosen(MOST_PICTURES).tolist():
        meshes = shown(around.scene, camera, look.moved(around.at(frame)))
        meshes.append(own.moved(replace(thing, vertices=points.at(frame))))
        yield photograph(PreparedMeshes(meshes), camera, config, low_light=True).rgb
