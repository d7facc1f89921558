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
from tasks.render.settled_meshes import SettledScene, at_rest, settled_mesh, settled_scene, shown
from tasks.render.stage import photograph

Array = NDArray[np.float64]

MOST_PICTURES = 60
"""Pictures of a drop [-]: with the last one held, three seconds of film."""


class MovingScene:
    """The scene at any frame: dents, and things that were placed before and move."""

    def __init__(self, scene: Segmentation, settled: Settled, base_id: str) -> None:
        self.around: SettledScene = settled_scene(scene, settled, base_id)
        self.settled = settled
        self.start = self.around.start
        placed = {one.id: one.placed for one in scene.instances}
        self.moving = [
            (number, placed[body.name], self._vertices(body.name, whole=placed[body.name]))
            for number, body in enumerate(settled.bodies)
            if number and body.name in placed and np.abs(body.displacement).max(initial=0.0) > 0.0
        ]
        """Number of each body that moves, whether it does as a thing of its own, and the vertices that follow it."""

    def _vertices(self, name: str, *, whole: bool) -> NDArray[np.int64]:
        """Vertices of a thing, or of a support only those around its dent."""
        mine = np.unique(self.start.faces[self.around.scene.face_instance == self.around.scene.index_of(name)])
        if whole:
            return np.asarray(mine)
        dented = mine[np.abs(self.around.shift[mine]).max(axis=1) > 0.0]
        if not len(dented):
            return np.asarray(dented)
        points, moved = self.start.vertices[mine], self.start.vertices[dented]
        low, high = moved.min(axis=0) - FAR, moved.max(axis=0) + FAR
        return np.asarray(mine[((points >= low) & (points <= high)).all(axis=1)])

    def at(self, frame: int) -> Mesh:
        """The scene's mesh at a frame."""
        vertices = self.start.vertices.copy()
        for number, whole, mine in self.moving:
            body = body_at(self.settled, number, frame)
            if whole:
                thing = Mesh.of(vertices[mine], np.zeros((0, 3)))
                vertices[mine] = at_rest(thing, body).vertices
            elif len(mine):
                surface = Mesh(body.surface.vertices - body.displacement, body.surface.faces, body.surface.colors)
                vertices[mine] += DisplacementField(surface, body.displacement).at(vertices[mine])
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
