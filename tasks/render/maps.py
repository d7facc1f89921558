"""Conditioning maps of a placement: all passes of one view, for inserting the object into photographs.

In: the settled scene and object, with their parts and materials, and a camera. Out: `ConditioningMaps`. Every pass is
made from the same rays, so that pixels agree; masks and the object's own colours are antialiased at its rim, while
numbers and ids are those of the pixel's middle. Nothing is added to the scene: unlike in pictures for people, a scene
without a floor gets none.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from dcap.arrays import Array, Float32Array
from dcap.geometry.camera import Camera
from dcap.geometry.raycast import Raycaster, packed_rays
from dcap.geometry.rendering.coverage import coverage, share_bytes, silhouette
from dcap.geometry.rendering.painted import caster_of
from dcap.geometry.rendering.picture import Exposure, exposed, in_bytes
from dcap.geometry.rendering.shading import gathered_light, shade
from dcap.scene.errors import InputError
from dcap.scene.types.choices import Anchor
from dcap.scene.types.materials import PartMaterials
from dcap.scene.types.mesh import Mesh, PaintedMesh, SourceSurface
from dcap.scene.types.pictures import HIDDEN_CONTACT, SEEN_CONTACT, ConditioningMaps
from dcap.scene.types.segmentation import Segmentation
from dcap.scene.types.settled import Settled
from tasks.render.config import RenderConfig
from tasks.render.contact_picture import dents, near_patch
from tasks.render.settled_meshes import (
    SettledScene,
    painted_item,
    painted_scene,
    settled_scene,
    shown_faces,
)

LUMINANCE = np.array([0.2126, 0.7152, 0.0722], dtype=np.float32)
"""Luminance weights of linear sRGB [Rec. ITU-R BT.709]."""
DARK = 1e-3
"""Light below which a place is dark even without the object [-]: a seam cannot show a shadow."""
AXES = np.concatenate([np.eye(3), -np.eye(3)])
OBJECT = "object"


@dataclass(frozen=True, eq=False, slots=True)
class SettledView:
    """Content of the view."""

    around: SettledScene
    item: Segmentation
    thing: PaintedMesh
    """The object at rest with its textures, faces as in `item`."""
    contact: Array
    """Points of the contact patch [m], shape (k, 3)."""
    materials: PartMaterials | None
    look: PaintedMesh
    """The scene at rest with its textures, faces as in `around`."""


def placed(
    scene: Segmentation, item: Segmentation, anchor: Anchor, materials: PartMaterials | None, settled: Settled,
    scene_surface: SourceSurface | None = None, object_surface: SourceSurface | None = None,
) -> SettledView:  # fmt: skip
    """The view of a settled placement."""
    thing = painted_item(item, anchor, settled.bodies[0], object_surface)
    around = settled_scene(scene, settled, anchor.base_id)
    return SettledView(around, item, thing, settled.contact_points, materials, painted_scene(around, scene_surface))


def conditioning_maps(what: SettledView, camera: Camera, config: RenderConfig, *, cutaway: bool) -> ConditioningMaps:
    """All passes of one view.

    Args:
        what: the placement.
        camera: the camera.
        config: how many rays a pixel has at edges.
        cutaway: leave out walls and ceiling between the camera and its target, as in pictures of rooms.

    Raises InputError if the camera is inside the object.
    """
    check_outside(what.thing.mesh, camera)
    scene = what.around.scene
    faces = shown_faces(scene, camera) if cutaway else np.arange(len(scene.mesh.faces))
    meshes = [what.look.submesh(faces)]
    exposure = exposed([*meshes, what.thing], camera)
    number = len(meshes)
    share, color = coverage(exposure, number, config.samples)
    alone = silhouette(caster_of([what.thing]), camera, config.samples)
    surface, shape = exposure.surface, exposure.shape
    seen = surface.mesh_index >= 0
    bare = caster_of(meshes)
    normal = np.where(seen, surface.smooth, 0.0).T
    ids, names = identities(what, exposure, faces, number)
    return ConditioningMaps(
        rgb=exposure.picture(config.samples).rgb,
        object_rgb=in_bytes(color.reshape(3, -1), shape),
        depth=exposure.depth,
        normal_world=normal.reshape(*shape, 3).astype(np.float32),
        normal_camera=(normal @ camera.world_from_camera).reshape(*shape, 3).astype(np.float32),
        object_mask=share_bytes(share),
        hidden_mask=share_bytes(np.clip(alone - share, 0.0, 1.0)),
        contact=contact_map(what.contact, exposure, bare, number),
        shadow=shadow_of(exposure, bare, number),
        ambient_occlusion=np.where(seen, exposure.light[1], 1.0).reshape(shape).astype(np.float32),
        dent=dents(what.around.shift[np.unique(scene.mesh.faces[faces])], exposure),
        instance=ids["instance"], part=ids["part"], material=ids["material"],
        names=names,
    )  # fmt: skip


def check_outside(thing: Mesh, camera: Camera) -> None:
    """Raise InputError if the camera is inside the object: rays along most axes then leave it through a back face."""
    hits = Raycaster(thing).cast(np.broadcast_to(camera.position, AXES.shape), AXES)
    backs = (np.einsum("ij,ij->i", hits.normal, AXES) > 0.0) & (hits.face >= 0)
    if backs.sum() >= len(AXES) - 1:
        place = ", ".join(f"{one:.3f}" for one in camera.position)
        raise InputError(f"the camera at ({place}) m is inside the object; move it outside (--camera FILE)")


def shadow_of(exposure: Exposure, bare: Raycaster, thing: int) -> Float32Array:
    """Light on the scene with the object over light without it, as luminance, shape (h, w); on the object the value of
    the nearest pixel outside it, as pixels at its rim show both."""
    surface, scene = exposure.surface, exposure.scene
    before = gathered_light(bare, surface, scene.light, scene.reach, exposure.shape)
    lit, unlit = (LUMINANCE @ shade(surface, light, scene.light) for light in (exposure.light, before))
    on_scene = (surface.mesh_index >= 0) & (surface.mesh_index != thing) & (unlit > DARK)
    ratio = np.where(on_scene, lit / np.maximum(unlit, DARK), 1.0).reshape(exposure.shape)
    mine = (surface.mesh_index == thing).reshape(exposure.shape)
    if mine.any() and not mine.all():
        row, column = distance_transform_edt(mine, return_distances=False, return_indices=True)
        ratio = ratio[row, column]
    return np.asarray(np.clip(ratio, 0.0, 1.0), dtype=np.float32)


def contact_map(contact: Array, exposure: Exposure, bare: Raycaster, thing: int) -> NDArray[np.uint8]:
    """Pixels of the contact patch, both visible and hidden by the object, shape (h, w)."""
    result = np.zeros(exposure.shape[0] * exposure.shape[1], dtype=np.uint8)
    if not len(contact):
        return result.reshape(exposure.shape)
    camera, surface = exposure.scene.camera, exposure.surface
    behind = np.flatnonzero(surface.mesh_index == thing)
    ways = surface.direction[:, behind].T
    hits = bare.first_hits(packed_rays(np.broadcast_to(camera.position, ways.shape), ways))
    met = np.isfinite(hits.distance)
    points = camera.position + hits.distance[met, None] * ways[met].astype(np.float64)
    result[behind[met][near_patch(points, contact, camera)]] = HIDDEN_CONTACT
    seen = np.flatnonzero(surface.mesh_index >= 0)
    result[seen[near_patch(surface.position[:, seen].T.astype(np.float64), contact, camera)]] = SEEN_CONTACT
    return result.reshape(exposure.shape)


def identities(
    what: SettledView, exposure: Exposure, faces: NDArray[np.int64], thing: int
) -> tuple[dict[str, NDArray[np.uint16]], dict[str, dict[str, str]]]:
    """Ids of instance, part and material in each pixel, (h, w) each, and their names."""
    scene, surface = what.around.scene, exposure.surface
    names: dict[str, dict[str, str]] = {"instance": {}, "part": {}, "material": {}}
    known = {(row.body, row.part): row.material.id for row in what.materials.rows} if what.materials else {}
    material = {name: number for number, name in enumerate(sorted(set(known.values())), 1)}
    names["material"] = {str(number): name for name, number in material.items()}
    rows = [(one.id, one.label, [part.name for part in one.parts]) for one in scene.instances]
    rows.append((OBJECT, what.item.instances[0].label, [part.name for part in what.item.instances[0].parts]))
    first: list[int] = []
    table = [(0, 0)]
    for number, (body, label, parts) in enumerate(rows, 1):
        names["instance"][str(number)] = label if body == OBJECT else f"{body}: {label}"
        first.append(len(table))
        for part in parts:
            names["part"][str(len(table))] = f"{body}/{part}"
            table.append((len(table), material.get(known.get((body, part), ""), 0)))
    of_part = np.array(table)
    owner, piece = (np.zeros(len(surface.face), dtype=np.int64) for _ in range(2))
    for mesh, one, offset in ((0, scene, 0), (thing, what.item, len(scene.instances))):
        mine = np.flatnonzero(surface.mesh_index == mesh)
        face = surface.face[mine].astype(np.int64) - int((exposure.scene.prepared.mesh_of_face < mesh).sum())
        face = faces[face] if mesh == 0 else face
        instance = one.face_instance[face].astype(np.int64)
        owner[mine] = np.where(instance >= 0, instance + 1 + offset, 0)
        place = np.array(first)[np.maximum(instance, 0) + offset] + one.face_part[face]
        piece[mine] = np.where((instance >= 0) & (one.face_part[face] >= 0), place, 0)
    shape = exposure.shape
    return {
        "instance": owner.reshape(shape).astype(np.uint16),
        "part": piece.reshape(shape).astype(np.uint16),
        "material": of_part[piece, 1].reshape(shape).astype(np.uint16),
    }, names
