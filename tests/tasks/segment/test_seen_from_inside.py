"""What a small scan shows is one thing, unless it is seen from inside, as a piece of a room is."""

import numpy as np
import trimesh
from scans import scan_of

from dcap.language.offline.client import OfflineClient
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.segmentation import Segmentation
from tasks.segment.stage import SegmentConfig, segment


def test_the_corner_of_a_room_is_no_thing() -> None:
    """Two walls and a floor that look at each other; the same faces seen from outside are one thing, however open."""
    box = trimesh.creation.box((0.7, 0.6, 0.9)).subdivide().subdivide()
    kept = (box.face_normals[:, 2] < 0.5) & (box.face_normals[:, 0] < 0.5) & (box.face_normals[:, 1] < 0.5)
    for turned, label in ((True, "room"), (False, "thing")):
        faces = box.faces[kept][:, ::-1] if turned else box.faces[kept]
        none = np.full(len(faces), -1, dtype=np.int32)
        scan = scan_of(Segmentation(Mesh.of(np.asarray(box.vertices), faces), (), none, none))
        (found,) = segment(scan, SegmentConfig(), OfflineClient()).instances
        assert (found.label, found.structure) == (label, turned)
