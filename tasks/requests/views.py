"""A segmentation as input of the clients of `language`: names, boxes, sizes, colours.

In: a scene or object. Out: plain views of its instances and parts, without any choice.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dcap.language.protocol.requests import InstanceView, ObjectView, PartView, Vector, vector
from dcap.scene.types.segmentation import Instance, Segmentation

LEVEL = 0.5
"""Vertical part of a unit normal above which a face faces up: within 60 degrees, so that sloped shades count."""


@dataclass(frozen=True, eq=False, slots=True)
class Sums:
    """Sums over the faces of every part; parts are counted through all instances."""

    first: NDArray[np.int64]
    """Index of each instance's first part, shape (instances + 1,)."""
    area: NDArray[np.float64]
    """Area of each part [m^2], shape (parts,)."""
    support: NDArray[np.float64]
    """Upward area [m^2], shape (parts,); downward area of a part without any."""
    color: NDArray[np.float64]
    """Area times sRGB colour 0..1, shape (parts, 3)."""


def sums_of(scene: Segmentation) -> Sums:
    """Sums from one pass over all faces."""
    first = np.cumsum([0, *(len(instance.parts) for instance in scene.instances)])
    known = (scene.face_instance >= 0) & (scene.face_part >= 0)
    number = first[scene.face_instance[known]] + scene.face_part[known]
    normals = scene.mesh.face_normals[known]
    length = np.linalg.norm(normals, axis=1)
    steep = LEVEL * np.maximum(length, 1e-30)
    shade = scene.mesh.colors[scene.mesh.faces[known]].mean(axis=1) / 255.0
    count = int(first[-1])
    up, down = (np.bincount(number, 0.5 * length * (way > steep), count) for way in (normals[:, 2], -normals[:, 2]))
    return Sums(
        first=first,
        area=np.bincount(number, 0.5 * length, count).astype(np.float64),
        support=np.where(up > 0.0, up, down).astype(np.float64),  # a sheet has two sides, however it is wound
        color=np.stack([np.bincount(number, 0.5 * length * shade[:, k], count) for k in range(3)], axis=1),
    )


def mean_color(color: NDArray[np.float64], area: float) -> Vector:
    """Mean sRGB colour of an area, 0..1; grey if the area is zero."""
    return vector(color / area) if area > 0 else (0.5, 0.5, 0.5)


def part_views(scene: Segmentation, index: int, sums: Sums | None = None) -> tuple[PartView, ...]:
    """The parts of one instance."""
    sums = sums_of(scene) if sums is None else sums
    views = []
    for number, part in enumerate(scene.instances[index].parts):
        row = int(sums.first[index]) + number
        views.append(
            PartView(
                index=number,
                name=part.name,
                center=vector(part.box.center),
                size=vector(2.0 * part.box.half_extents),
                support_area=float(sums.support[row]),
                color=mean_color(sums.color[row], float(sums.area[row])),
            )
        )
    return tuple(views)


def instance_views(scene: Segmentation) -> tuple[InstanceView, ...]:
    """All instances."""
    sums, views = sums_of(scene), []
    for index, instance in enumerate(scene.instances):
        corners = instance.box.corners
        mine = slice(int(sums.first[index]), int(sums.first[index + 1]))
        view = InstanceView(
            id=instance.id,
            label=instance.label,
            center=vector(instance.box.center),
            size=vector(2.0 * instance.box.half_extents),
            low=vector(corners.min(axis=0)),
            high=vector(corners.max(axis=0)),
            front=None if instance.front is None else vector(instance.front),
            structure=instance.structure,
            color=mean_color(sums.color[mine].sum(axis=0), float(sums.area[mine].sum())),
            parts=part_views(scene, index, sums),
            guesses=instance.guesses,
            confidence=instance.confidence,
        )
        views.append(view)
    return tuple(views)


def object_view(item: Segmentation) -> ObjectView:
    """The object as read from its file."""
    extents = np.sort(np.ptp(item.mesh.bounds, axis=0))[::-1]
    return ObjectView(item.instances[0].label, vector(extents), part_views(item, 0))


def room_center(scene: Segmentation) -> NDArray[np.float64]:
    """Middle of the floor's box, or of the whole scene without a labelled floor [m], shape (3,)."""
    floor = next((i for i in scene.instances if i.structure and "floor" in i.label), None)
    return np.asarray(floor.box.center if floor else scene.mesh.bounds.mean(axis=0))


def instance_of(scene: Segmentation, instance_id: str) -> Instance:
    """The instance with this id."""
    return scene.instances[scene.index_of(instance_id)]
