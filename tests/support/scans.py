"""Scans of rooms made of boxes, in a file's own frame."""

import numpy as np

from dcap.scene.readers.frame import WORLD_FROM_FILE
from dcap.scene.types.scan import Scan
from dcap.scene.types.segmentation import Segmentation


def scan_of(scene: Segmentation, up: str = "z", unit: float = 1.0) -> Scan:
    """What a file with that mesh gives, nothing named, its axis `up` upward and its unit so long [m]."""
    map_ = np.eye(4)
    map_[:3, :3] = unit * np.array(WORLD_FROM_FILE[up])
    faces = len(scene.mesh.faces)
    return Scan(scene.mesh, np.full(faces, -1, np.int32), (), (), (), "room", map_, up, unit, "option", ())
