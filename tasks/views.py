"""A segmentation as the clients of `language` see it: names, boxes, sizes, colours.

In: a scene or object. Out: plain views of its instances and parts; nothing is chosen here.
"""

import numpy as np
from numpy.typing import NDArray

from language.requests import InstanceView, ObjectView, PartView, Vector
from scene.mesh import Mesh
from scene.segmentation import Instance, Segmentation

LEVEL = 0.5
"""A face looks up if its unit normal's vertical component exceeds this: within 60 degrees, as sloped shades count."""


def vector(values: NDArray[np.floating]) -> Vector:
    """Three floats."""
    x, y, z = (float(v) for v in values)
    return x, y, z


def mean_color(mesh: Mesh, faces: NDArray[np.integer]) -> Vector:
    """Area-weighted mean sRGB colour of some faces, 0..1."""
    area = mesh.face_areas[faces]
    if area.sum() == 0.0:
        return 0.5, 0.5, 0.5
    shade = mesh.colors[mesh.faces[faces]].mean(axis=1)
    return vector(np.average(shade, axis=0, weights=area) / 255.0)


def part_views(scene: Segmentation, index: int) -> tuple[PartView, ...]:
    """The parts of one instance."""
    instance = scene.instances[index]
    mine = scene.face_instance == index
    normals = scene.mesh.face_normals
    length = np.maximum(np.linalg.norm(normals, axis=1), 1e-30)
    up = normals[:, 2] / length
    views = []
    for number, part in enumerate(instance.parts):
        faces = np.flatnonzero(mine & (scene.face_part == number))
        views.append(
            PartView(
                index=number,
                name=part.name,
                center=vector(part.box.center),
                size=vector(2.0 * part.box.half_extents),
                support_area=float(0.5 * length[faces][up[faces] > LEVEL].sum()),
                color=mean_color(scene.mesh, faces),
            )
        )
    return tuple(views)


def instance_view(scene: Segmentation, index: int) -> InstanceView:
    """One instance."""
    instance = scene.instances[index]
    corners = instance.box.corners
    return InstanceView(
        id=instance.id,
        label=instance.label,
        center=vector(instance.box.center),
        size=vector(2.0 * instance.box.half_extents),
        low=vector(corners.min(axis=0)),
        high=vector(corners.max(axis=0)),
        front=None if instance.front is None else vector(instance.front),
        structure=instance.structure,
        color=mean_color(scene.mesh, np.flatnonzero(scene.face_instance == index)),
        parts=part_views(scene, index),
    )


def instance_views(scene: Segmentation) -> tuple[InstanceView, ...]:
    """All instances."""
    return tuple(instance_view(scene, index) for index in range(len(scene.instances)))


def object_view(item: Segmentation) -> ObjectView:
    """The object as read."""
    extents = np.sort(np.ptp(item.mesh.bounds, axis=0))[::-1]
    return ObjectView(item.instances[0].label, vector(extents), part_views(item, 0))


def room_center(scene: Segmentation) -> NDArray[np.float64]:
    """Middle of the floor's box, or of everything where no floor is named [m], shape (3,)."""
    floor = next((i for i in scene.instances if i.structure and "floor" in i.label), None)
    return np.asarray(floor.box.center if floor else scene.mesh.bounds.mean(axis=0))


def instance_of(scene: Segmentation, instance_id: str) -> Instance:
    """The instance with this id."""
    return scene.instances[scene.index_of(instance_id)]
