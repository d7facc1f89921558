"""Object and scene for files of the rest state, with the faces and textures of their sources.

In: results of the stages. Out: painted meshes. For a source without textures it is the stages' mesh. Faces of a support
are only cut where it bends.
"""

from dataclasses import replace

import numpy as np

from dcap.geometry.rendering.painted import nearest_faces, own_paint, paint_from
from dcap.scene.types.anchor import Anchor
from dcap.scene.types.paint import PaintedMesh, SourceSurface
from dcap.scene.types.segmentation import Segmentation
from dcap.scene.types.settled import Settled, SettledBody
from tasks.render.settled_meshes import SettledScene, settled_item, settled_mesh, settled_scene


def object_at_rest(item: Segmentation, surface: SourceSurface, anchor: Anchor, body: SettledBody) -> PaintedMesh:
    """The object at rest."""
    if not surface.kept:
        return PaintedMesh(settled_item(item, anchor, body))
    return PaintedMesh(settled_mesh(surface.mesh, anchor, body), own_paint(surface))


def scene_at_rest(
    scene: Segmentation, surface: SourceSurface, settled: Settled | None, base_id: str
) -> tuple[SettledScene, PaintedMesh]:
    """The scene with its dents, and its look; unchanged if nothing has settled in it."""
    own = of_source(scene, surface)
    around = untouched(own) if settled is None else settled_scene(own, settled, base_id)
    paint = paint_from(surface, around.start, around.origin) if surface.kept else None
    return around, PaintedMesh(around.scene.mesh, paint)


def untouched(scene: Segmentation) -> SettledScene:
    """A scene in which nothing has moved."""
    return SettledScene(scene, np.zeros_like(scene.mesh.vertices), scene.mesh, np.arange(len(scene.mesh.faces)))


def of_source(scene: Segmentation, surface: SourceSurface) -> Segmentation:
    """The scene's things and parts on the faces of its textured source."""
    if not surface.kept:
        return scene
    owner = nearest_faces(scene.mesh, surface.mesh)
    known = owner >= 0
    return replace(
        scene,
        mesh=surface.mesh,
        face_instance=np.where(known, scene.face_instance[owner], -1).astype(np.int32),
        face_part=np.where(known, scene.face_part[owner], -1).astype(np.int32),
    )
