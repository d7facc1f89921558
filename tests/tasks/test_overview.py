"""Pictures of an infeasible placement look at what is known."""

import numpy as np

from dcap.scene.types.boxes import OrientedBox
from dcap.scene.types.choices import Anchor
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.segmentation import Instance, Part, Segmentation, SegmentedObject, SegmentedScene
from tasks.overview import OverviewConfig, overview

CORNERS = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)], dtype=float)
FACES = [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1], [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4],
         [1, 5, 7], [1, 7, 3]]  # fmt: skip


def block(
    size: tuple[float, float, float], low: tuple[float, float, float], color: tuple[int, int, int]
) -> Segmentation:
    """A coloured block with one instance 'a' around it."""
    mesh = Mesh.of(CORNERS * size + low, FACES, color)
    box = OrientedBox(mesh.bounds.mean(axis=0), np.eye(3), 0.5 * np.ptp(mesh.bounds, axis=0))
    index = np.zeros(12, np.int32)
    return Segmentation(mesh, (Instance("a", "table", box, (Part("body", box, 1.0),), None),), index, index)


def test_the_object_is_shown_where_it_should_have_gone() -> None:
    """The asked picture differs from the clean one around its middle, by the object's colour."""
    scene = block((1.0, 1.0, 0.5), (0, 0, 0), (90, 90, 90))
    item = block((0.2, 0.2, 0.2), (0, 0, 0), (220, 20, 20))
    pose = np.eye(4)
    pose[:3, 3] = 0.4, 0.4, 0.51
    top = np.array([0.5, 0.5, 0.5])
    anchor = Anchor("a", "body", 0, "center", np.zeros(2), top, pose, 0.01, np.zeros((4, 2)), "")
    config = OverviewConfig(size=96)
    shown = overview(SegmentedScene(scene), SegmentedObject(item), None, anchor, config)
    assert shown.asked is not None
    change = np.abs(shown.asked.astype(int) - shown.clean).sum(axis=2)
    rows, columns = np.nonzero(change > 60)
    assert abs(columns.mean() - 48) < 10
    red = shown.asked[rows, columns].astype(int)
    assert np.median(red[:, 0] - red[:, 1]) > 80
    assert overview(SegmentedScene(scene), SegmentedObject(item), None, None, config).asked is None
