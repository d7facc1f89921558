"""How well rooms are taken apart: instances and parts against the truth that the embedded rooms are made from.

python -m perf.segments          a row for each room
"""

import tempfile
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from evaluation.segment_scores import Score, Truth, scores
from geometry.distance import MeshDistance
from geometry.procedural.rooms import ROOMS, BuiltRoom, build_room
from scene.interiorgs_write import write_interiorgs
from scene.mesh import Mesh
from scene.sample import SourceOptions
from scene.scan import Scan
from scene.store import Source
from tasks.mesh import MeshConfig, mesh
from tasks.segment import SegmentConfig, segment

SHELL = ("wall", "floor", "ceiling")


@dataclass(frozen=True, slots=True)
class Means:
    """Mean IoU over a number of rooms."""

    instances: float
    """Of all instances, floor, ceiling and walls too [-]."""
    things: float
    """Of those that are not."""
    parts: float
    """Of the parts of things."""


def read_room(name: str, seed: int = 0) -> tuple[BuiltRoom, Scan]:
    """A room and what is read from its files."""
    room = build_room(name, seed)
    with tempfile.TemporaryDirectory() as folder:
        write_interiorgs(Path(folder) / name, room.record, seed)
        return room, mesh(Source(Path(folder) / name), SourceOptions(), MeshConfig())


def truth_on(room: BuiltRoom, found: Mesh) -> Truth:
    """The truth of a room on the faces of another mesh of it, each as the nearest true face."""
    nearest = MeshDistance(room.record.mesh).nearest_face(found.triangles.mean(axis=1))
    return Truth(room.instance_ids, room.instance_labels, room.face_instance[nearest], room.face_part[nearest])


def without_annotations(scan: Scan) -> Scan:
    """The mesh alone."""
    return replace(scan, boxes=(), rooms=())


def room_scores(room: BuiltRoom, scan: Scan) -> list[Score]:
    """The scores of a room's own segmentation."""
    return scores(truth_on(room, scan.mesh), segment(scan, SegmentConfig()))


def means(rows: list[Score]) -> Means:
    """Mean overlaps."""
    things = [row for row in rows if row.label not in SHELL]
    parts = [iou for row in things for _, iou in row.parts]
    return Means(*(float(np.mean(one)) for one in ([r.iou for r in rows], [r.iou for r in things], parts)))


def main() -> None:
    """Measure and print."""
    table = Table("room", "boxes: all", "things", "parts", "none: all", "things", "parts", box=None)
    with_boxes: list[Score] = []
    without: list[Score] = []
    for name in ROOMS:
        room, scan = read_room(name)
        found = [room_scores(room, one) for one in (scan, without_annotations(scan))]
        with_boxes += found[0]
        without += found[1]
        table.add_row(name, *(f"{v:.3f}" for one in map(means, found) for v in (one.instances, one.things, one.parts)))
    total = (means(with_boxes), means(without))
    table.add_row("all", *(f"{v:.3f}" for one in total for v in (one.instances, one.things, one.parts)))
    Console(highlight=False, width=120).print(table)


if __name__ == "__main__":
    main()
