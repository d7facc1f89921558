"""Rooms without annotations: what is found in them has names, sizes and parts, whoever is asked."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from dcap.geometry.primitives import Box
from dcap.language.connect import connect
from dcap.language.offline.client import OfflineClient
from dcap.language.protocol.client import ClientName, LanguageConfig
from dcap.language.protocol.questions import LABEL, Question
from dcap.language.protocol.replies import LabelReply
from dcap.language.protocol.requests import LabelRequest
from dcap.language.protocol.session import Session
from dcap.scene.errors import LanguageError
from dcap.scene.types.boxes import OrientedBox
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.scan import LabelBox, Scan
from dcap.scene.types.segmentation import Segmentation
from dcap.synthetic.rooms import build_room
from dcap.synthetic.shapes import joined, moved
from perf.segment_scores import GroundTruth, Score, label_accuracy, means_the_same, scores
from tasks.requests.pictures import LOUD, SIZE
from tasks.segment.stage import SegmentConfig, segment

STRUCTURE = {"floor", "wall", "ceiling"}


def bare(mesh: Mesh, names: tuple[str, ...] = (), node: np.ndarray | None = None) -> Scan:
    """A scan that says nothing of what is in it, but for the given nodes."""
    none = np.full(len(mesh.faces), -1, dtype=np.int32)
    return Scan(mesh, none if node is None else node, names, (), (), "", np.eye(4), "z", 1.0, "format", ())


def block(low: tuple[float, float, float], high: tuple[float, float, float]) -> Mesh:
    """A closed box."""
    a, b = np.array(low), np.array(high)
    return moved(Box(b - a).surface(0.15), *(0.5 * (a + b)))


def small_room() -> list[Mesh]:
    """The inside of a room of 2.2 x 2.6 x 2.4 m, a wardrobe, and a box on the floor."""
    shell = block((0.0, 0.0, 0.0), (2.2, 2.6, 2.4))
    inside = Mesh(shell.vertices, shell.faces[:, ::-1], shell.colors)
    return [inside, block((0.2, 1.97, 0.001), (1.5, 2.57, 2.0)), block((1.2, 0.5, 0.001), (1.7, 0.85, 0.25))]


def scored(name: str, seed: int = 0) -> tuple[Segmentation, list[Score]]:
    """A generated room, stripped of its annotation, and how what was found agrees with what it was made of."""
    room = build_room(name, seed)
    found = segment(bare(room.record.mesh), SegmentConfig(), OfflineClient())
    truth = GroundTruth(room.instance_ids, room.instance_labels, room.face_instance, room.face_part)
    return found, scores(truth, found)


def check_room(name: str, *, labels: float) -> None:
    """Instances overlap the truth by 0.75 on average, the stated share of things has the right label."""
    found, rows = scored(name)
    things = [row for row in rows if row.label not in STRUCTURE]
    assert np.mean([row.iou for row in rows]) > 0.75
    assert label_accuracy(things) >= labels
    assert len({one.id for one in found.instances}) == len(found.instances)
    sure = {one.id: one.confidence for one in found.instances}
    assert all(0.0 <= value <= 1.0 for value in sure.values())
    assert all(sure[one.id] == 1.0 for one in found.instances if one.structure)


@pytest.mark.slow
def test_a_bathroom_without_annotations() -> None:
    """Every thing of a bathroom is found under its name, the tank in the toilet, the basin in its cabinet."""
    check_room("bathroom_01", labels=1.0)


@pytest.mark.slow
@pytest.mark.parametrize("name", [pytest.param("living_02", marks=pytest.mark.long), "guest_01"])
def test_rooms_without_annotations(name: str) -> None:
    """Nine of ten things of rooms of other kinds are found under their names."""
    check_room(name, labels=0.9)


def labels_of(found: Segmentation) -> set[str]:
    return {one.label for one in found.instances}


def test_what_is_unnamed_in_a_named_scene_is_found() -> None:
    """Nodes with names keep them; what no node names is taken apart and named by shape."""
    shell, wardrobe, box = small_room()
    parcel = block((0.3, 0.3, 0.001), (0.6, 0.6, 0.25))
    meshes = [shell, wardrobe, parcel, box]
    node = np.repeat([-1, 0, 1, -1], [len(mesh.faces) for mesh in meshes]).astype(np.int32)
    found = segment(bare(joined(meshes), ("Rocket", "Parcel"), node), SegmentConfig(), OfflineClient())
    assert {"rocket", "parcel", "box", "floor", "wall"} <= labels_of(found)
    assert next(one.confidence for one in found.instances if one.label == "rocket") == 1.0
    assert next(one.confidence for one in found.instances if one.label == "box") < 1.0


@pytest.mark.slow
def test_a_model_is_asked_only_where_nothing_else_says(monkeypatch: pytest.MonkeyPatch) -> None:
    """With boxes around things of one part no client is needed; without boxes the model is, its absence is an error."""
    for name in ("ANTHROPIC_API_KEY", "ANTHROPIC_AUTH_TOKEN", "ANTHROPIC_PROFILE"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("ANTHROPIC_BASE_URL", "http://127.0.0.1:9")
    model = connect(LanguageConfig(client=ClientName.ANTHROPIC, endpoint="127.0.0.1-9"), Session())
    scan = bare(joined(small_room()))
    box = LabelBox("1", "mirror", OrientedBox(np.array([0.85, 2.3, 1.0]), np.eye(3), np.array([0.66, 0.31, 1.01])))
    assert "mirror" in labels_of(segment(replace(scan, boxes=(box,)), SegmentConfig(), model))
    with pytest.raises(LanguageError):
        segment(scan, SegmentConfig(), model)


def test_the_client_decides_and_sees_each_thing() -> None:
    """Each thing is asked once, carriers first; the answer is its label; one picture shows it in a loud colour."""
    asked: list[LabelRequest] = []

    class Painter(OfflineClient):
        def ask(self, question: Question[Any, Any], request: Any) -> Any:
            if question is not LABEL:
                return super().ask(question, request)
            asked.append(request)
            return LabelReply(label="piano" if request.size[2] > 1.0 else "other", confidence=0.7)

    table, cup = block((0.3, 0.3, 0.001), (1.2, 0.9, 0.7)), block((0.6, 0.5, 0.7), (0.75, 0.65, 0.85))
    shell, wardrobe, _ = small_room()
    found = segment(bare(joined([shell, wardrobe, table, cup])), SegmentConfig(), Painter())
    assert len(asked) == 3
    assert asked[-1].held_by == asked[1].id
    assert sorted((one.label, one.confidence) for one in found.instances if not one.structure) == [
        ("piano", 0.7), ("thing", 0.0), ("thing", 0.0),
    ]  # fmt: skip
    room, near = (one.make() for one in asked[-1].pictures)
    assert room.shape == near.shape == (SIZE, SIZE, 3)
    loud = np.abs(room.astype(float) / 255.0 - LOUD / 255.0).sum(axis=2) < 1.0
    assert 20 < loud.sum() < 0.2 * SIZE * SIZE
    assert not (np.abs(near.astype(float) / 255.0 - LOUD / 255.0).sum(axis=2) < 1.0).any()


@pytest.mark.parametrize(
    ("found", "true", "right"),
    [
        ("sofa", "multi person sofa", True),
        ("cabinet", "shoe cabinet", True),
        ("coffee table", "teatable", True),
        ("desk", "table", True),
        ("bed", "sofa", False),
        ("thing", "vase", False),
        ("", "vase", False),
    ],
)
def test_which_labels_are_right(found: str, true: str, right: bool) -> None:
    """Synonyms and kinds of a thing are right, other things and no label are wrong."""
    assert means_the_same(found, true) is right
