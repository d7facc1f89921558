"""`dcap language check`: a dozen questions with known answers, the first thing to run with a new key.

In: a model. Out: a row for each question with the right answer, the model's, tokens, seconds (pictures included) and
cost. Room and objects are embedded ones; the stages are the real ones, so each question is asked as in a placement. The
first question that the API refuses ends it with its line.
"""

import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path
from typing import TypeVar

import numpy as np

from dcap.evaluation.judging.judge import pair_request
from dcap.evaluation.judging.known_answers import known_answers
from dcap.evaluation.judging.questions import JUDGE_PAIR
from dcap.evaluation.statistics.comparisons import Winner
from dcap.language.connect import Client, connect
from dcap.language.model.ledger import ReplyLine, read_lines
from dcap.language.offline.client import OfflineClient
from dcap.language.protocol.client import ClientName
from dcap.language.protocol.questions import LABEL, PARTS, Question, ReplyT, RequestT
from dcap.language.protocol.requests import LabelRequest, PartsRequest
from dcap.scene.errors import InputError, LanguageError, RefusedError
from dcap.scene.types.choices import Anchor, Intent, Rotation
from dcap.scene.types.materials import BodyModel, PartMaterials
from dcap.scene.types.sample import SourceOptions
from dcap.scene.types.scan import Scan
from dcap.scene.types.segmentation import SegmentedObject, SegmentedScene
from dcap.synthetic.dataset import make_dataset
from flows.configure import LanguageOptions
from tasks.anchor.stage import AnchorConfig, anchor
from tasks.artifact import Source
from tasks.intent.stage import IntentConfig, intent
from tasks.materials.stage import OBJECT, MaterialsConfig, materials
from tasks.mesh.stage import MeshConfig, mesh_object, mesh_scene
from tasks.rotation.stage import RotationConfig, rotation
from tasks.segment.stage import SegmentConfig, segment, segment_object

ResultT = TypeVar("ResultT")
ROOM = "bedroom_01"


@dataclass(frozen=True, slots=True)
class KnownPlacement:
    """A sentence about the room, with its correct reading."""

    object: str
    prompt: str
    base: str
    """Label of the support."""
    part: str
    up: float
    """Height of the object's own upward axis in the requested pose: 1 upright, -1 upside down."""
    model: BodyModel
    """Whether the object is rigid."""


PLACEMENTS = (
    KnownPlacement("dumbbell", "Lay the dumbbell on the foot end of the bed.", "bed", "blanket", 1.0, BodyModel.RIGID),
    KnownPlacement("mug", "Put the mug upside down on the upholstered stool.", "stool", "seat", -1.0, BodyModel.RIGID),
)


@dataclass(frozen=True, slots=True)
class CheckedAnswer:
    """One question with its expected and its actual answer."""

    question: str
    expected: str
    answered: str
    right: bool
    tokens: int
    """In and out."""
    seconds: float
    usd: float | None
    """[USD]; None where the model's price is not known."""


@dataclass(slots=True)
class Meter:
    """A client that measures tokens, time and cost since the last row."""

    client: Client
    ledger: Path
    seconds: float = 0.0
    lines: int = 0

    def ask(self, question: Question[RequestT, ReplyT], request: RequestT) -> ReplyT:
        """The answer to one question."""
        begin = time.perf_counter()
        try:
            return self.client.ask(question, request)
        finally:
            self.seconds += time.perf_counter() - begin

    def ask_all(self, question: Question[RequestT, ReplyT], requests: Sequence[RequestT]) -> list[ReplyT]:
        """The answers, one after the other."""
        return [self.ask(question, one) for one in requests]

    def row(self, question: str, expected: str, answer: Callable[[], tuple[str, bool]]) -> CheckedAnswer:
        """Ask; return the answer, whether it is right, and its cost. An invalid answer counts as wrong."""
        try:
            answered, right = answer()
        except RefusedError:
            raise
        except LanguageError as error:
            answered, right = str(error), False
        found = read_lines(self.ledger)
        taken = [line for line in found[self.lines :] if isinstance(line, ReplyLine)]
        seconds, self.seconds, self.lines = self.seconds, 0.0, len(found)
        costs = [line.usd for line in taken if line.usd is not None]
        tokens = sum(
            line.input_tokens + line.output_tokens + line.cache_write_tokens + line.cache_read_tokens for line in taken
        )
        usd = sum(costs) if len(costs) == len(taken) else None
        return CheckedAnswer(question, expected, answered, right, tokens, seconds, usd)


@dataclass(slots=True)
class Listener:
    """Answers like the embedded reader, and records the questions about things and parts."""

    asked: list[LabelRequest | PartsRequest] = field(default_factory=list)

    def ask(self, question: Question[RequestT, ReplyT], request: RequestT) -> ReplyT:
        """The reader's answer."""
        if isinstance(request, LabelRequest | PartsRequest):
            self.asked.append(request)
        return OfflineClient().ask(question, request)

    def ask_all(self, question: Question[RequestT, ReplyT], requests: Sequence[RequestT]) -> list[ReplyT]:
        """One after the other."""
        return [self.ask(question, one) for one in requests]


def check_language(
    options: LanguageOptions, folder: Path, say: Callable[[CheckedAnswer], None] = lambda row: None
) -> list[CheckedAnswer]:
    """Ask all questions; LanguageError at the first that the API refuses, InputError if no model was named."""
    config = options.config()
    if config.client not in (ClientName.ANTHROPIC, ClientName.OPENAI):
        raise InputError("dcap language check needs --language anthropic or openai: offline and replay ask no model")
    # a folder of its own: kept replies would prove nothing, and these answers belong to no placement
    session = replace(options.session(folder), fresh=True, kept=str(folder / "replies"), record="", replay="")
    Path(session.ledger).unlink(missing_ok=True)
    meter = Meter(connect(config, session), Path(session.ledger))
    found = []
    with tempfile.TemporaryDirectory(prefix="dcap-check-") as made:
        make_dataset(Path(made), 0, rooms=[ROOM])
        for row in answers(Path(made), meter):
            say(row)
            found.append(row)
    return found


def answers(data: Path, meter: Meter) -> Iterator[CheckedAnswer]:
    """The rows, one by one."""
    scan = mesh_scene(Source(data / "rooms" / ROOM), SourceOptions(), MeshConfig())
    scene = segment(scan, SegmentConfig(), OfflineClient())
    for known in PLACEMENTS:
        file = Source(data / "objects" / f"{known.object}.glb")
        item = segment_object(mesh_object(file, SourceOptions(), MeshConfig()), SegmentConfig(), OfflineClient())
        yield from placement_answers(scene, item, known, meter)
    yield from name_answers(scan, scene, meter)
    yield judge_answer(meter)


def placement_answers(
    scene: SegmentedScene, item: SegmentedObject, known: KnownPlacement, meter: Meter
) -> Iterator[CheckedAnswer]:
    """The four questions of a placement. Each is asked with the right answers to the earlier ones, taken from the
    embedded reader."""
    reader = OfflineClient()
    meant = stage_result(Intent, intent(scene, item, known.prompt, None, IntentConfig(ambiguous="best"), reader))
    turned = stage_result(Rotation, rotation(scene, item, meant, known.prompt, RotationConfig(), reader))
    found = stage_result(Anchor, anchor(scene, item, meant, turned, known.prompt, AnchorConfig(), reader))

    def base() -> tuple[str, bool]:
        said = intent(scene, item, known.prompt, None, IntentConfig(ambiguous="best"), meter)
        label = said.base_label if isinstance(said, Intent) else said.message
        return label, label == known.base

    def pose() -> tuple[str, bool]:
        said = rotation(scene, item, meant, known.prompt, RotationConfig(), meter)
        if not isinstance(said, Rotation):
            return said.message, False
        up = float(said.matrix[2, 2])
        return f"{up:+.2f} ({said.candidate})", bool(np.isclose(up, known.up, atol=0.1))

    def part() -> tuple[str, bool]:
        said = anchor(scene, item, meant, turned, known.prompt, AnchorConfig(), meter)
        name = said.part if isinstance(said, Anchor) else said.message
        return name, name == known.part

    def made() -> tuple[str, bool]:
        said = materials(scene, item, meant, found, known.prompt, MaterialsConfig(), meter)
        if not isinstance(said, PartMaterials):
            return said.message, False
        own = [row for row in said.rows if row.body == OBJECT]
        return ", ".join(sorted({row.material.id for row in own})), all(row.model is known.model for row in own)

    yield meter.row("intent", known.base, base)
    yield meter.row("rotation", f"own top at {known.up:+.0f}", pose)
    yield meter.row("anchor", known.part, part)
    yield meter.row("materials", f"{known.object}: {known.model.value}", made)


def stage_result(kind: type[ResultT], result: object) -> ResultT:
    """A stage's result; a test makes sure that the embedded reader places both objects."""
    if not isinstance(result, kind):
        raise TypeError(f"expected {kind.__name__}, found {result}")
    return result


def name_answers(scan: Scan, scene: SegmentedScene, meter: Meter) -> Iterator[CheckedAnswer]:
    """Names of two things and of the parts of one, in the same room without its names."""
    listener = Listener()
    nameless = replace(scan, boxes=(), node_names=(), node_labels=(), face_node=np.full_like(scan.face_node, -1))
    segment(nameless, SegmentConfig(), listener)
    labels = [one for one in listener.asked if isinstance(one, LabelRequest)]
    for wanted in ("bed", "wardrobe"):
        size = next(np.sort(2.0 * one.box.half_extents) for one in scene.instances if one.label == wanted)
        request = min(labels, key=lambda one: float(np.abs(np.sort(one.size) - size).sum()))
        yield meter.row("label", wanted, partial(label_answer, meter, request, wanted))
    bed = next(one for one in listener.asked if isinstance(one, PartsRequest) and one.label == "bed")

    def parts() -> tuple[str, bool]:
        names = sorted({one.name for one in meter.ask(PARTS, bed).names})
        return ", ".join(names), "mattress" in names

    yield meter.row("parts", "bed: mattress among them", parts)


def label_answer(meter: Meter, request: LabelRequest, wanted: str) -> tuple[str, bool]:
    """The name of one thing, and whether it is right."""
    label = meter.ask(LABEL, request).label
    return label, label == wanted


def judge_answer(meter: Meter) -> CheckedAnswer:
    """Two placements, one of them hovering, in both orders: a model that always answers "right" fails."""
    known = known_answers(ROOM)[0]

    def better() -> tuple[str, bool]:
        orders = ((known.worse, known.better), (known.better, known.worse))
        said = [meter.ask(JUDGE_PAIR, pair_request(*order)).winner(known.axis) for order in orders]
        return ", ".join(map(str, said)), said == [Winner.RIGHT, Winner.LEFT]

    return meter.row("judge_pair", "right, left", better)


def row_in_words(row: CheckedAnswer) -> str:
    """A row for a person."""
    cost = "       ?" if row.usd is None else f"{row.usd:8.4f}"
    mark = "right" if row.right else "wrong"
    return (
        f"{mark}  {row.question:<10}  {row.expected:<28}  {row.answered[:40]:<40}  {row.tokens:>6} tokens  "
        f"{row.seconds:5.1f} s  {cost} USD"
    )


def totals_in_words(rows: Sequence[CheckedAnswer]) -> str:
    """Totals of all rows."""
    costs = [row.usd for row in rows if row.usd is not None]
    cost = f"{sum(costs):.4f} USD" if len(costs) == len(rows) else "at an unknown price"
    right, tokens, seconds = (
        sum(row.right for row in rows),
        sum(row.tokens for row in rows),
        sum(row.seconds for row in rows),
    )
    return f"{right} of {len(rows)} right; {tokens} tokens, {seconds:.0f} s, {cost}"
