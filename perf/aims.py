"""Accuracy of aims in the embedded rooms: base, part and region of intent and anchor against the truth.

python -m perf.aims          shares of the embedded samples, and every sample that is wrong
"""

import tempfile
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from rich.console import Console
from rich.table import Table

from dcap.evaluation.outcome_table import ExpectedOutcome, read_truth
from dcap.language.offline.client import OfflineClient
from dcap.scene.errors import LanguageError
from dcap.scene.types.choices import Anchor, Intent
from dcap.scene.types.outcome import Infeasible, Reason
from dcap.scene.types.sample import SourceOptions
from dcap.scene.types.segmentation import Segmentation, SegmentedObject, SegmentedScene
from dcap.scene.writers.meshes import write_object
from dcap.synthetic.dataset import build_object
from dcap.synthetic.recipes import object_recipes
from dcap.synthetic.rooms import BuiltRoom
from dcap.synthetic.shapes import joined
from flows.samples import EMBEDDED, TRUTH, load_yaml
from perf.aim_scores import Aim, Marks, aim_of, marks, shares
from perf.segments import read_room
from tasks.anchor.stage import AnchorConfig, anchor
from tasks.artifact import Source
from tasks.intent.stage import IntentConfig, intent
from tasks.mesh.stage import MeshConfig, mesh_object
from tasks.rotation.stage import RotationConfig, rotation
from tasks.segment.stage import SegmentConfig, segment, segment_object

BEFORE_THE_DROP = ("", Reason.TARGET_NOT_FOUND, Reason.NO_SUPPORT_HIT, Reason.TOO_LARGE_FOR_TARGET)
"""Reasons that are known before any simulation; other infeasible samples have an anchor."""
NOT_UNDERSTOOD = "not_understood"
"""Stands for a sentence that is refused."""
TAKE_THE_BEST = IntentConfig(ambiguous="best")
PICTURES = RotationConfig(picture_size=64)
"""Settings of pictures, which the offline client does not use."""


@dataclass(frozen=True, eq=False, slots=True)
class Shot:
    """Results of the stages up to the anchor for one sentence."""

    scene: Segmentation
    item: Segmentation
    intent: Intent | Infeasible | None
    """None for a sentence that was refused."""
    anchor: Anchor | Infeasible | None
    message: str
    """Message for a person: the anchor's reason, or why there is none."""

    @property
    def aim(self) -> Aim:
        """The aim in words."""
        return Aim(reason=NOT_UNDERSTOOD) if self.intent is None else aim_of(self.intent, self.anchor)


@cache
def room_of(name: str) -> tuple[BuiltRoom, Segmentation]:
    """An embedded room, as generated and as segmented from its files."""
    room, scan = read_room(name)
    return room, segment(scan, SegmentConfig(), OfflineClient())


@cache
def item_of(name: str) -> Segmentation:
    """An embedded object, segmented from its file."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / f"{name}.{object_recipes()[name].format}"
        write_object(path, [(part.name, joined(part.solids)) for part in build_object(name).parts])
        scan = mesh_object(Source(path), SourceOptions(), MeshConfig())
        return segment_object(scan, SegmentConfig(), OfflineClient())


def shot(room: str, item: str, prompt: str) -> Shot:
    """Intent, rotation and anchor for a sentence in an embedded room."""
    scene, thing = room_of(room)[1], item_of(item)
    try:
        meant = intent(SegmentedScene(scene), SegmentedObject(thing), prompt, None, TAKE_THE_BEST, OfflineClient())
    except LanguageError as error:
        return Shot(scene, thing, None, None, str(error))
    if isinstance(meant, Infeasible):
        return Shot(scene, thing, meant, None, meant.message)
    turned = rotation(SegmentedScene(scene), SegmentedObject(thing), meant, prompt, PICTURES, OfflineClient())
    if isinstance(turned, Infeasible):
        return Shot(scene, thing, turned, None, turned.message)
    found = anchor(
        SegmentedScene(scene), SegmentedObject(thing), meant, turned, prompt, AnchorConfig(), OfflineClient()
    )
    return Shot(scene, thing, meant, found, found.message if isinstance(found, Infeasible) else found.reason)


def aim_from(truth: ExpectedOutcome) -> Aim:
    """The part of an intended outcome that is known before the drop."""
    reason = truth.reason if truth.reason in BEFORE_THE_DROP else ""
    return Aim(truth.base_id, truth.part, truth.region, reason=reason)


def embedded() -> list[tuple[str, Shot, Aim, Marks]]:
    """Every embedded sample: its id, its aim, the intended aim, and the marks."""
    truths, result = read_truths(), []
    for row in read_samples():
        found = shot(row["room"], row["object"], row["prompt"])
        wanted = aim_from(truths[row["id"]])
        result.append((row["id"], found, wanted, marks(wanted, found.aim)))
    return result


def read_truths() -> dict[str, ExpectedOutcome]:
    """The intended outcomes of the embedded samples."""
    return read_truth(load_yaml(EMBEDDED.parent / TRUTH), TRUTH)


def read_samples() -> list[dict[str, str]]:
    """The embedded samples as written: id, room, object, prompt."""
    rows = load_yaml(EMBEDDED)
    assert isinstance(rows, list)
    return rows


def table(rows: list[tuple[str, Shot, Aim, Marks]]) -> Table:
    """The shares of right aims, then the wrong ones."""
    result = Table("sample", "wanted", "found", "says", box=None, title_justify="left")
    numbers = ", ".join(f"{name} {share:.1%}" for name, share in shares(row[3] for row in rows).items())
    result.title = f"{len(rows)} samples right: {numbers}"
    for name, found, wanted, mark in rows:
        if not mark.all_right:
            result.add_row(name, in_words(wanted), in_words(found.aim), found.message)
    return result


def in_words(aim: Aim) -> str:
    """An aim in one line."""
    words = (aim.reason, aim.base, aim.part, aim.region, " ".join(sorted(aim.references)))
    return " | ".join(word for word in words if word)


if __name__ == "__main__":
    Console(highlight=False, width=200).print(table(embedded()))
