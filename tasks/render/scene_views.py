"""A scene and the things in it, in front of several cameras.

In: the scene, its look and other meshes. Out: the meshes visible to each camera, prepared once for all.
"""

from collections.abc import Sequence

import numpy as np

from dcap.geometry.camera import Camera
from dcap.geometry.rendering.picture import Exposure, exposed
from dcap.geometry.rendering.surface import PreparedMeshes
from dcap.scene.types.paint import PaintedMesh
from dcap.scene.types.segmentation import Segmentation
from tasks.render.settled_meshes import Cutaway, floor_of


class SceneViews:
    """Views of a scene by several cameras."""

    def __init__(
        self, scene: Segmentation, look: PaintedMesh | None = None, things: Sequence[PaintedMesh] = ()
    ) -> None:
        """A scene, its look if it has textures, and meshes that are never cut away."""
        self._cutaway = Cutaway(scene)
        around = [look or PaintedMesh(scene.mesh), *floor_of(scene)]
        self._meshes = PreparedMeshes([*around, *things])
        self._things = self._meshes.mesh_of_face >= len(around)

    def seen_by(self, camera: Camera) -> PreparedMeshes:
        """Meshes visible to a camera: first the scene without cut-away faces, then the others."""
        cut = self._cutaway.faces(camera)
        shown = np.ones(len(self._things), dtype=bool)
        shown[: len(cut)] = ~cut
        return self._meshes.showing(shown)

    def exposed(self, camera: Camera, *, low_light: bool = False) -> Exposure:
        """A camera's view of the scene alone, still to be developed."""
        seen = self.seen_by(camera)
        return exposed(seen.showing(seen.shown & ~self._things), camera, low_light=low_light)

    def with_things(self, alone: Exposure) -> Exposure:
        """A view of the scene alone, with the other meshes added."""
        return alone.adding(self._things)
