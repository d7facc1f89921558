"""The instances of a scene in which things were placed before: as its folder says, nothing is asked or found again."""

import numpy as np

from dcap.scene.types.earlier import EarlierPlacements
from dcap.scene.types.scan import Scan
from dcap.scene.types.segmentation import Segmentation, part_nodes


def known_scene(scan: Scan, earlier: EarlierPlacements) -> Segmentation:
    """Each node of the scan is a part of an instance: `id/part`."""
    place = {
        node: (number, part)
        for number, one in enumerate(earlier.instances)
        for part, node in enumerate(part_nodes(one.id, [own.name for own in one.parts]))
    }
    owner = np.array([*(place.get(name, (-1, -1)) for name in scan.node_names), (-1, -1)], dtype=np.int32)
    instance, part = owner[scan.face_node].T
    return Segmentation(
        scan.mesh, earlier.instances, np.ascontiguousarray(instance), np.ascontiguousarray(part),
        unit_source=scan.unit_source,
    )  # fmt: skip
