"""The embedded rooms, segmented from their files alone and compared with the truth they were made from."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial import cKDTree

from geometry.procedural.rooms import ROOMS, BuiltRoom, build_room
from scene.interiorgs_write import write_interiorgs
from scene.sample import SourceOptions
from scene.segmentation import Segmentation
from scene.store import Source
from tasks.mesh import MeshConfig, mesh
from tasks.segment import SegmentConfig, segment

SUPPORT_PARTS = {"mattress", "blanket", "pillow", "seat cushion", "seat", "top", "board", "shade", "rim"}
"""Parts that things are placed on."""


def overlaps(name: str, folder: Path) -> tuple[dict[str, float], dict[tuple[str, str], float]]:
    """Area IoU of each annotated instance (by id) and of each of its support parts."""
    room = build_room(name, 0)
    write_interiorgs(folder / name, room.record, 0)
    found = segment(mesh(Source(folder / name), SourceOptions(), MeshConfig()), SegmentConfig())
    nearest = cKDTree(room.record.mesh.triangles.mean(axis=1)).query(found.mesh.triangles.mean(axis=1))[1]
    return compare(room, found, room.face_instance[nearest], room.face_part[nearest])


def compare(
    room: BuiltRoom, found: Segmentation, instance: np.ndarray, part: np.ndarray
) -> tuple[dict[str, float], dict[tuple[str, str], float]]:
    """Overlap of what was found with the truth per face."""
    area = found.mesh.face_areas
    names = np.array(
        [
            found.instances[i].parts[p].name if i >= 0 else ""
            for i, p in zip(found.face_instance, found.face_part, strict=True)
        ]
    )
    ids = np.array([*(one.id for one in found.instances), ""])[found.face_instance]

    def iou(a: np.ndarray, b: np.ndarray) -> float:
        return float(area[a & b].sum() / area[a | b].sum())

    instances, parts = {}, {}
    for index, identifier in enumerate(room.instance_ids):
        if identifier not in {one.id for one in found.instances}:
            continue
        mine, true = ids == identifier, instance == index
        instances[identifier] = iou(mine, true)
        for name in sorted(SUPPORT_PARTS & set(part[true])):
            parts[identifier, name] = iou(mine & (names == name), true & (part == name))
    return instances, parts


@pytest.mark.parametrize("name", [pytest.param(n, marks=() if n == "bedroom_01" else pytest.mark.slow) for n in ROOMS])
def test_embedded_rooms(name: str, tmp_path: Path) -> None:
    """Instances overlap the truth by 0.85 on average, the parts that carry by 0.7 each; every thing is found."""
    instances, parts = overlaps(name, tmp_path)
    assert len(instances) >= 5
    assert np.mean(list(instances.values())) > 0.85
    assert min(instances.values()) > 0.5
    assert min(parts.values()) > 0.7, parts
