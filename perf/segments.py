"""Quality of the segmentation of rooms: instances and parts against the truth of the embedded rooms.

python -m perf.segments          a row for each room: mean IoU with and without annotated boxes, share of right labels
"""

import tempfile
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from dcap.geometry.distance import MeshDistance
from dcap.language.offline.client import OfflineClient
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.sample import SourceOptions
from dcap.scene.types.scan import Scan
from dcap.scene.writers.interiorgs import write_interiorgs
from dcap.synthetic.recipes import room_names
from dcap.synthetic.rooms import BuiltRoom, build_room
from perf.segment_scores import GroundTruth, Score, label_accuracy, scores
from tasks.artifact import Source
from tasks.mesh.stage import MeshConfig, mesh_scene
from tasks.segment.stage import SegmentConfig, segment

SHELL = ("wall", "floor", "ceiling")


@dataclass(frozen=True, slots=True)
class Means:
    """Mean IoU over a number of rooms."""

    instances: float
    """Of all instances, floor, ceiling and walls too [-]."""
    things: float
    """Of all instances but floor, ceiling and walls [-]."""
    parts: float
    """Of the parts of things."""
    labels: float
    """Share of the things whose label is right [-]."""


def read_room(name: str, seed: int = 0) -> tuple[BuiltRoom, Scan]:
    """A room and the scan from its files."""
    room = build_room(name, seed)
    with tempfile.TemporaryDirectory() as folder:
        write_interiorgs(Path(folder) / name, room.record, seed)
        return room, mesh_scene(Source(Path(folder) / name), SourceOptions(), MeshConfig())


def truth_on(room: BuiltRoom, found: Mesh) -> GroundTruth:
    """The truth of a room on the faces of another mesh of it, each as the nearest true face."""
    nearest = MeshDistance(room.record.mesh).nearest_face(found.triangles.mean(axis=1))
    return GroundTruth(room.instance_ids, room.instance_labels, room.face_instance[nearest], room.face_part[nearest])


def without_annotations(scan: Scan) -> Scan:
    """The mesh alone."""
    return replace(scan, boxes=(), rooms=())


def on_mesh(scan: Scan, other: Mesh) -> Scan:
    """Facts of a room's source, with another mesh of it."""
    return replace(scan, mesh=other, face_node=np.full(len(other.faces), -1, dtype=np.int32))


def room_scores(room: BuiltRoom, scan: Scan) -> list[Score]:
    """The scores of a room's own segmentation."""
    return scores(truth_on(room, scan.mesh), segment(scan, SegmentConfig(), OfflineClient()))


def means(rows: list[Score]) -> Means:
    """Mean overlaps."""
    things = [row for row in rows if row.label not in SHELL]
    parts = [iou for row in things for _, iou in row.parts]
    return Means(
        instances=float(np.mean([row.iou for row in rows])),
        things=float(np.mean([row.iou for row in things])),
        parts=float(np.mean(parts)),
        labels=label_accuracy(things),
    )


def both_ways(room: BuiltRoom, scan: Scan) -> tuple[list[Score], list[Score]]:
    """Scores with the source's annotations, and without."""
    return room_scores(room, scan), room_scores(room, without_annotations(scan))


def rows_of(name: str, found: tuple[list[Score], list[Score]]) -> list[str]:
    """A row of the table."""
    boxes, none = map(means, found)
    numbers = (boxes.instances, boxes.things, boxes.parts, none.instances, none.things, none.parts, none.labels)
    return [name, *(f"{number:.3f}" for number in numbers)]


def heads() -> Table:
    """The table without rows."""
    return Table("room", "boxes: all", "things", "parts", "none: all", "things", "parts", "labels", box=None)


def table() -> Table:
    """A row for each embedded room, and one for all of them."""
    result = heads()
    found = []
    for name in room_names():
        found.append(both_ways(*read_room(name)))
        result.add_row(*rows_of(name, found[-1]))
    every = ([s for boxes, _ in found for s in boxes], [s for _, none in found for s in none])
    result.add_row(*rows_of("all", every))
    return result


if __name__ == "__main__":
    Console(highlight=False, width=120).print(table())
