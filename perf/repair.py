"""Repairs parts for simulation: every support of every embedded room, and the sample meshes.

python -m perf.repair [--all]      print the table; --all: every part, not only those that things are placed on
"""

import os
import sys
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from dcap.geometry.solid.closed import simulation_ready
from dcap.geometry.solid.support import shell_bottoms
from dcap.language.offline.client import OfflineClient
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.sample import SourceOptions
from dcap.scene.types.scan import RepairReport
from dcap.scene.types.segmentation import Segmentation
from dcap.synthetic.recipes import room_names
from perf.segments import read_room
from tasks.artifact import Source
from tasks.mesh.stage import MeshConfig, mesh_scene
from tasks.particles.config import ParticlesConfig
from tasks.segment.stage import SegmentConfig, segment, segment_object

SUPPORTS = frozenset({"mattress", "blanket", "pillow", "seat cushion", "seat", "top", "board", "shade", "rim", "floor"})
"""Parts that things are placed on."""
MESHES = (".obj", ".glb", ".gltf")
SAMPLES = "DCAP_SAMPLE_DATA"
"""The environment variable that names the folder of the sample data."""
UNREADABLE = "draco"
"""Files of this name, which the readers refuse correctly."""


@dataclass(frozen=True, slots=True)
class PartRepair:
    """One part."""

    place: str
    thing: str
    part: str
    support: bool
    report: RepairReport
    seconds: float

    @property
    def good(self) -> bool:
        """Whether it is closed, has a certain inside, and its surface has hardly moved."""
        return not self.report.problem


def room_rows(name: str, *, every: bool = False) -> Iterator[PartRepair]:
    """The supports of one embedded room, found by segmenting its files; `every`: all parts of all its things."""
    scene = segment(read_room(name)[1], SegmentConfig(), OfflineClient())
    yield from support_rows(name, scene, every=every)


def support_rows(place: str, scene: Segmentation, *, every: bool = False) -> Iterator[PartRepair]:
    """The parts of a scene, each solid down to the depth that the drop assumes."""
    for index, instance in enumerate(scene.instances):
        for number, part in enumerate(instance.parts):
            faces = np.flatnonzero((scene.face_instance == index) & (scene.face_part == number))
            support = part.name in SUPPORTS
            if len(faces) == 0 or not (support or (every and not instance.structure)):
                continue
            piece = scene.mesh.submesh(faces)
            floor = shell_bottoms(piece, np.full(len(faces), part.box.bottom), ParticlesConfig().shell)
            yield row(place, instance.label, part.name, support, piece, floor)


def row(place: str, thing: str, part: str, support: bool, piece: Mesh, floor: np.ndarray | None) -> PartRepair:
    """Repair of one part, with its time."""
    begin = time.perf_counter()
    _, report = simulation_ready(piece, floor=floor)
    return PartRepair(place, thing, part, support, report, time.perf_counter() - begin)


def sample_rows(folder: Path, *, every: bool = False) -> Iterator[PartRepair]:
    """The objects, whole, and the supports and rooms, part by part, of the sample data."""
    for path in sorted(p for p in folder.rglob("*") if p.suffix in MESHES and UNREADABLE not in p.name):
        kind, _, name = path.parent.name.partition("_")
        place = f"{name}/{path.stem}"
        scan = mesh_scene(Source(path), SourceOptions(label=name.split("_")[0]), MeshConfig())
        if kind == "obj":
            thing = segment_object(scan, SegmentConfig(), OfflineClient())
            yield row(place, thing.instances[0].label, "all", True, thing.mesh, None)
        elif kind in ("sup", "room"):
            yield from support_rows(place, segment(scan, SegmentConfig(), OfflineClient()), every=every)


def summary(what: str, rows: list[PartRepair]) -> str:
    """One line about many parts."""
    good = sum(r.good for r in rows)
    closed = sum(r.report.closed for r in rows)
    anew = sum(r.report.resolution > 0.0 for r in rows)
    worst = max(rows, key=lambda r: r.report.hausdorff)
    return (
        f"{what}: {closed} of {len(rows)} closed, {good} good, {anew} meshed again; worst Hausdorff "
        f"{1e3 * worst.report.hausdorff:.2f} mm ({worst.place} {worst.thing} {worst.part}), mean "
        f"{1e3 * float(np.mean([r.report.mean for r in rows])):.4f} mm, {sum(r.seconds for r in rows):.0f} s"
    )


def print_rows(rows: list[PartRepair], console: Console) -> None:
    """The table and its summary."""
    table = Table("where", "thing", "part", "closed", "Hausdorff mm", "mean mm", "litres", "s", "remarks", box=None)
    for r in rows:
        remarks = "; ".join([r.report.problem, *r.report.repairs] if r.report.problem else r.report.repairs)
        table.add_row(
            r.place, r.thing, r.part, "yes" if r.report.closed else "NO", f"{1e3 * r.report.hausdorff:.3f}",
            f"{1e3 * r.report.mean:.4f}", f"{1e3 * r.report.volume:.2f}", f"{r.seconds:.1f}", remarks,
        )  # fmt: skip
    console.print(table)


def measured(*, every: bool = False) -> tuple[list[PartRepair], list[PartRepair]]:
    """Rows of the embedded rooms and, if $DCAP_SAMPLE_DATA names it, of the sample data."""
    rooms = [r for name in room_names() for r in room_rows(name, every=every)]
    folder = os.environ.get(SAMPLES)
    return rooms, list(sample_rows(Path(folder), every=every)) if folder else []


def summaries(rooms: list[PartRepair], samples: list[PartRepair]) -> list[str]:
    """Lines for `python -m perf`."""
    lines = [summary("supports of the embedded rooms", [r for r in rooms if r.support])]
    if len(rooms) > sum(r.support for r in rooms):
        lines.append(summary("all parts of the embedded rooms", rooms))
    if samples:
        lines.append(summary("sample data", samples))
    elif SAMPLES not in os.environ:
        lines.append(f"sample data: not measured ({SAMPLES} is not set)")
    return lines


def main() -> None:
    """Measure and print."""
    console = Console(highlight=False, width=200)
    rooms, samples = measured(every="--all" in sys.argv[1:])
    print_rows(rooms + samples, console)
    for line in summaries(rooms, samples):
        console.print(line)


if __name__ == "__main__":
    main()
