"""The scale of a file without a unit, from the height of one thing in it."""

from dataclasses import replace

import numpy as np
import pytest
from box_rooms import block, segmentation
from scans import scan_of

from dcap.language.offline.client import OfflineClient
from dcap.scene.errors import InputError
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.sample import KnownHeight
from dcap.scene.types.scan import Scan
from tasks.segment.known_height import found_scale, scaled
from tasks.segment.stage import SegmentConfig

TOP = 0.74
"""Height of the table [m]."""


def table(x: float, y: float, top: float, half: tuple[float, float]) -> Mesh:
    """A board on four legs."""
    legs = [
        block((x + i * (half[0] - 0.08), y + j * (half[1] - 0.08), 0), (x + i * (half[0] - 0.08) + 0.05,
              y + j * (half[1] - 0.08) + 0.05, top - 0.03))
        for i in (-1, 1) for j in (-1, 1)
    ]  # fmt: skip
    return Mesh.concatenate([block((x - half[0], y - half[1], top - 0.03), (x + half[0], y + half[1], top)), *legs])


def room(factor: float) -> Scan:
    """Floor, walls, a dining table and a low bench, as a file of which a metre is `factor` units says it."""
    walls = [block((-2.5, y, 0), (2.5, y + 0.1, 2.6)) for y in (-2.1, 2.0)]
    walls += [block((x, -2.1, 0), (x + 0.1, 2.1, 2.6)) for x in (-2.6, 2.5)]
    whole = Mesh.concatenate(
        [
            block((-2.5, -2, -0.1), (2.5, 2, 0)),
            *walls,
            table(0.5, 0.3, TOP, (0.8, 0.45)),
            table(-1.5, -1.2, 0.3, (0.5, 0.2)),
        ]
    )
    return scaled(scan_of(segmentation({"room": ("room", None, [("body", whole)])})), factor)


@pytest.mark.parametrize("factor", [7.3, 0.11])
def test_a_table_of_known_height_gives_the_unit(factor: float) -> None:
    """Whatever the scale of the file; to the accuracy of the surface."""
    scan = room(factor)
    found = found_scale(scan, KnownHeight("table", TOP), SegmentConfig(), OfflineClient())
    assert factor * found.metres / scan.unit_metres == pytest.approx(1.0, rel=1e-3)
    assert "--height-of table=0.74" in found.note


def test_named_things_need_no_guess() -> None:
    """A node that the file calls a desk is one at any scale; its surface gives the unit."""
    scan = room(5.0)
    top = np.ptp(scan.mesh.triangles[:, :, 2], axis=1) < 1e-6
    high = np.isclose(scan.mesh.triangles[:, :, 2].max(axis=1), 5 * TOP)
    node = np.where(top & high, 0, -1).astype(np.int32)
    named = replace(scan, face_node=node, node_names=("desk", "lamp"))
    found = found_scale(named, KnownHeight("desk", 0.5 * TOP), SegmentConfig(), OfflineClient())
    assert found.metres == pytest.approx(scan.unit_metres * 0.5 / 5, rel=1e-3)


def test_a_thing_that_is_nowhere() -> None:
    """One line with the heights at which something looks up, and what to do."""
    with pytest.raises(InputError, match=r"no bathtub is found .* give the height of another thing, or --unit"):
        found_scale(room(2.0), KnownHeight("bathtub", 0.5), SegmentConfig(), OfflineClient())
