"""The drop as a film: the object coming down and the dent forming, frame by frame.

In: scene and object as segmented, the settled state with its frames, and a camera. Out: pictures. The scene is cut as
finely as its final dent asks once, and then follows the simulated surface of each frame.
"""

from collections.abc import Iterator

import numpy as np
from numpy.typing import NDArray

from dcap.geometry.camera import Camera
from dcap.geometry.deform import FAR, DisplacementField
from dcap.geometry.rendering.painted import painted
from dcap.scene.types.anchor import Anchor
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.paint import PaintedMesh, SourceSurface
from dcap.scene.types.segmentation import Segmentation
from dcap.scene.types.settled import Settled, body_at
from tasks.render.config import RenderConfig
from tasks.render.settled_meshes import SettledScene, settled_mesh, settled_scene, shown
from tasks.render.stage import photograph

Array = NDArray[np.float64]

MOST_PICTURES = 60
"""Pictures of a drop [-]: with the last one held, three seconds of film."""


class MovingScene:
    """The scene with the dents of any frame."""

    def __init__(self, scene: Segmentation, settled: Settled, base_id: str) -> None:
        self.around: SettledScene = settled_scene(scene, settled, base_id)
        self.settled = settled
        self.start = self.around.start
        self.body = next((i for i, one in enumerate(settled.bodies) if i and one.name == base_id), None)
        self.near = np.zeros(0, dtype=np.int64)
        if self.body is not None and self.around.shift.any():
            moved = self.start.vertices[np.abs(self.around.shift).max(axis=1) > 0.0]
            low, high = moved.min(axis=0) - FAR, moved.max(axis=0) + FAR
            mine = np.unique(self.start.faces[self.around.scene.face_instance == scene.index_of(base_id)])
            inside = ((self.start.vertices[mine] >= low) & (self.start.vertices[mine] <= high)).all(axis=1)
            self.near = mine[inside]

    def at(self, frame: int) -> Mesh:
        """The scene's mesh at a frame."""
        if self.body is None or not len(self.near):
            return self.start
        body = body_at(self.settled, self.body, frame)
        surface = Mesh(body.surface.vertices - body.displacement, body.surface.faces, body.surface.colors)
        vertices = self.start.vertices.copy()
        vertices[self.near] += DisplacementField(surface, body.displacement).at(vertices[self.near])
        return Mesh(vertices, self.start.faces, self.start.colors)


def chosen_frames(settled: Settled) -> NDArray[np.int64]:
    """Numbers of the frames that are shown; the last one is the rest state."""
    assert settled.frames is not None
    count = len(settled.frames.time)
    return np.unique(np.round(np.linspace(0, count - 1, min(count, MOST_PICTURES))).astype(np.int64))


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
    moving = MovingScene(scene, settled, anchor.base_id)
    look, thing = painted(moving.start, surfaces[0]), painted(item.mesh, surfaces[1])
    for frame in chosen_frames(settled):
        around = shown(moving.around.scene, camera, look.moved(moving.at(int(frame))))
        own = settled_mesh(item.mesh, anchor, body_at(settled, 0, int(frame)))
        yield photograph([*around, PaintedMesh(own, thing.paint)], camera, config, low_light=True).rgb
