"""Whether the named thing is found in rooms without annotations.

python -m perf.scans [ROOM ...]      a row for each room and noun; then the calibration of likelihoods

Embedded rooms without their annotations, the same as scanned by a depth camera, and, if DCAP_SAMPLE_DATA names a folder
of third-party rooms, those of `scans.yaml`. Right: the box of the chosen thing overlaps the true one by half
(intersection over union; for flat things their plans), and the point at which a ball would be set down is over it.
"""

import itertools
import json
import os
import sys
import tempfile
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rich.console import Console
from rich.table import Table
from ruamel.yaml import YAML

from dcap.geometry.segmentation.labels import Category, category_of
from dcap.language.offline.client import OfflineClient
from dcap.scene.errors import DcapError
from dcap.scene.types.boxes import OrientedBox
from dcap.scene.types.choices import Anchor, Intent
from dcap.scene.types.outcome import Infeasible
from dcap.scene.types.sample import SourceOptions
from dcap.scene.types.scan import Scan
from dcap.scene.types.segmentation import SegmentedObject, SegmentedScene
from dcap.scene.writers.meshes import write_object
from dcap.synthetic.dataset import build_object
from dcap.synthetic.recipes import room_names
from dcap.synthetic.scan import scanned
from dcap.synthetic.shapes import joined
from perf.segments import on_mesh, read_room, without_annotations
from tasks.anchor.stage import AnchorConfig, anchor
from tasks.artifact import Source
from tasks.intent.stage import IntentConfig, intent
from tasks.mesh.stage import MeshConfig, mesh_object, mesh_scene
from tasks.rotation.stage import RotationConfig, rotation
from tasks.segment.stage import SegmentConfig, segment, segment_object

Box = NDArray[np.float64]
OVERLAP = 0.5
"""Least intersection over union of a right box [-]."""
TOLERANCE = 0.05
"""Distance outside of the true box within which a point counts as over it [m]: boxes are drawn by hand."""
THICKNESS = 0.1
"""Height below which only the plans of things are compared [m]: a rug has no height."""
SUPPORTS = frozenset({
    Category.BED, Category.SOFA, Category.CHAIR, Category.STOOL, Category.TABLE, Category.CABINET, Category.SHELF,
    Category.STORAGE, Category.BATHTUB,
})  # fmt: skip
BINS = (1e-9, 0.15, 0.35, 0.6, 0.8, 0.95, 1.01)
"""Bounds of the bins of likelihood for the share of right answers [-]."""
FLAT = frozenset({"rug", "carpet", "floor"})
"""Further nouns of supports."""


@dataclass(frozen=True, eq=False, slots=True)
class ScanRoom:
    """A room with its truth."""

    name: str
    scan: Scan
    truth: dict[str, list[Box]]
    """Axis-aligned boxes in the world, each of shape (2, 3), by their noun."""


@dataclass(frozen=True, slots=True)
class NounScore:
    """Result for one noun."""

    room: str
    noun: str
    overlap: float
    over: bool
    likelihood: float
    """Likelihood according to the program, 0 if nothing is chosen."""
    second: str
    """Second candidate with its likelihood; empty without one."""
    said: str

    @property
    def right(self) -> bool:
        """Whether the right thing is chosen."""
        return self.overlap >= OVERLAP and self.over


def rooms(wanted: list[str]) -> Iterator[ScanRoom]:
    """Embedded rooms, then those of third parties, by a part of their names."""
    for name in room_names():
        if not wanted or any(one in name for one in wanted):
            _, scan = read_room(name)
            truth: dict[str, list[Box]] = {}
            for one in scan.boxes:
                if category_of(one.label) in SUPPORTS or one.label in FLAT:
                    truth.setdefault(one.label, []).append(bounds(one.box))
            yield ScanRoom(name, without_annotations(scan), truth)
            yield ScanRoom(f"{name} scanned", on_mesh(without_annotations(scan), scanned(scan.mesh)), truth)
    folder = Path(os.environ.get("DCAP_SAMPLE_DATA") or "nowhere")
    for name, said in YAML(typ="safe", pure=True).load(Path(__file__).with_name("scans.yaml")).items():
        if (folder / name).is_file() and (not wanted or any(one in name for one in wanted)):
            scan = mesh_scene(Source(folder / name), SourceOptions(), MeshConfig())
            boxes = {noun: [in_world(box, scan) for box in drawn] for noun, drawn in known(folder / name, said)}
            yield ScanRoom(name, scan, boxes)


def known(path: Path, said: dict[str, object]) -> Iterator[tuple[str, list[object]]]:
    """Nouns and boxes of a third-party room, in its file's frame."""
    names = said.get("names", {})
    if "boxes" in said and isinstance(names, dict):
        found = json.loads((path.parent / str(said["boxes"])).read_bytes())["boxes"]
        for noun, label in names.items():
            yield noun, [one["aabb"] for one in found if one["label"] == label]
    for noun, boxes in said.items():
        if noun not in ("boxes", "names") and isinstance(boxes, list):
            yield noun, boxes


def in_world(box: object, scan: Scan) -> Box:
    """The world bounds of a box in the file's frame, shape (2, 3)."""
    low, high = np.array(box, dtype=np.float64)
    corners = np.array([[(low, high)[i][0], (low, high)[j][1], (low, high)[k][2]]
                        for i in (0, 1) for j in (0, 1) for k in (0, 1)])  # fmt: skip
    there = corners @ scan.world_from_file[:3, :3].T + scan.world_from_file[:3, 3]
    return np.stack([there.min(axis=0), there.max(axis=0)])


def bounds(box: OrientedBox) -> Box:
    """Axis-aligned bounds of a box, shape (2, 3)."""
    return np.stack([box.corners.min(axis=0), box.corners.max(axis=0)])


def overlap(a: Box, b: Box) -> float:
    """Intersection over union of two boxes, or of their plans where one is flat [-]."""
    if min(np.ptp(a[:, 2]), np.ptp(b[:, 2])) < THICKNESS:
        a, b = (np.c_[one[:, :2], [0.0, 1.0]] for one in (a, b))
    shared = float(np.prod(np.maximum(np.minimum(a[1], b[1]) - np.maximum(a[0], b[0]), 0.0)))
    return shared / (float(np.prod(a[1] - a[0]) + np.prod(b[1] - b[0])) - shared)


def answers(room: ScanRoom, item: SegmentedObject) -> Iterator[NounScore]:
    """One score for each noun."""
    scene = segment(room.scan, SegmentConfig(), OfflineClient())
    for noun, boxes in room.truth.items():
        yield answer(room.name, SegmentedScene(scene), item, noun, boxes)


def answer(room: str, scene: SegmentedScene, item: SegmentedObject, noun: str, boxes: list[Box]) -> NounScore:
    """The chosen thing for a noun, and the place where a ball would be set down."""
    client, prompt = OfflineClient(), f"put the ball on the {noun}"
    try:
        found = intent(scene, item, prompt, None, IntentConfig(ambiguous="best"), client)
        if isinstance(found, Infeasible):
            return NounScore(room, noun, 0.0, False, 0.0, "", found.message)
        place = placed(scene, item, found, prompt)
    except DcapError as error:
        return NounScore(room, noun, 0.0, False, 0.0, "", str(error))
    base = scene.instances[scene.index_of(found.base_id)]
    likelihood, second = found.candidates[0].score, second_of(found)
    best = max(boxes, key=lambda box: overlap(bounds(base.box), box))
    share = overlap(bounds(base.box), best)
    if not isinstance(place, Anchor):
        return NounScore(room, noun, share, False, likelihood, second, f"{base.id}: {place.message}")
    point = place.surface_point[:2]
    over = bool(((point > best[0, :2] - TOLERANCE) & (point < best[1, :2] + TOLERANCE)).all())
    return NounScore(room, noun, share, over, likelihood, second, f"{base.id} ({place.part})")


def second_of(found: Intent) -> str:
    """The second candidate with its likelihood; empty without one."""
    return next((f"{one.id} {one.score:.2f}" for one in found.candidates[1:]), "")


def placed(scene: SegmentedScene, item: SegmentedObject, found: Intent, prompt: str) -> Anchor | Infeasible:
    """Place where the ball would be set down."""
    client = OfflineClient()
    turned = rotation(scene, item, found, prompt, RotationConfig(), client)
    if isinstance(turned, Infeasible):
        return turned
    return anchor(scene, item, found, turned, prompt, AnchorConfig(), client)


def ball() -> SegmentedObject:
    """The object that is placed everywhere."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "ball.glb"
        write_object(path, [(part.name, joined(part.solids)) for part in build_object("ball").parts])
        scan = mesh_object(Source(path), SourceOptions(), MeshConfig())
    return SegmentedObject(segment_object(scan, SegmentConfig(), OfflineClient()))


def calibration(found: list[NounScore]) -> Table:
    """Likelihoods of answers against their share of right ones; refusals have no likelihood."""
    table = Table("likelihood", "answers", "mean", "right", box=None)
    for low, high in itertools.pairwise(BINS):
        mine = [one for one in found if low <= one.likelihood < high]
        means = mean([one.likelihood for one in mine]), mean([one.right for one in mine])
        table.add_row(f"{low:.2f} to {min(high, 1.0):.2f}", str(len(mine)), *means)
    table.add_row("refused", str(sum(one.likelihood == 0.0 for one in found)), "-", "-")
    return table


def mean(values: Sequence[float]) -> str:
    """The mean in words, "-" of nothing."""
    return f"{np.mean(values):.2f}" if values else "-"


def main(wanted: list[str]) -> None:
    """Print a row for each noun, as soon as it is known, and the totals."""
    console, item, found = Console(highlight=False, width=150), ball(), list[NounScore]()
    for room in rooms(wanted):
        for one in answers(room, item):
            found.append(one)
            verdict = "right" if one.right else "WRONG"
            sure = f"{one.likelihood:.2f} (second: {one.second or '-'})"
            console.print(f"{one.room:40s} {one.noun:16s} {verdict} {one.overlap:.2f} {sure} {one.said}")
    console.print(f"{sum(one.right for one in found)} of {len(found)} right")
    console.print(calibration(found))


if __name__ == "__main__":
    main(sys.argv[1:])
