"""A scene and what stands in it before several cameras.

In: the scene, its look and other meshes. Out: the meshes that each camera may see, prepared once for all that see the
same of them.
"""

from collections.abc import Sequence

from dcap.geometry.camera import Camera
from dcap.geometry.rendering.surface import PreparedMeshes
from dcap.scene.types.paint import PaintedMesh
from dcap.scene.types.segmentation import Segmentation
from tasks.render.settled_meshes import shown_faces, shown_meshes


class SceneViews:
    """What cameras see of a scene; keeps what it prepared."""

    def __init__(
        self, scene: Segmentation, look: PaintedMesh | None = None, things: Sequence[PaintedMesh] = ()
    ) -> None:
        """A scene, its look if it has textures, and meshes that are never cut away."""
        self.scene, self.look, self.things = scene, look, tuple(things)
        self._known: dict[bytes, PreparedMeshes] = {}

    def seen_by(self, camera: Camera) -> PreparedMeshes:
        """What a camera may see: the scene without what is cut away, then the other meshes."""
        faces = shown_faces(self.scene, camera)
        key = faces.tobytes()
        if key not in self._known:
            self._known[key] = PreparedMeshes([*shown_meshes(self.scene, faces, self.look), *self.things])
        return self._known[key]
