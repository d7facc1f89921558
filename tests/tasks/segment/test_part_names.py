"""Geometry proposes part names, a client decides: names and confidences change, faces and boxes stay."""

from typing import Any

import numpy as np
import pytest

from dcap.geometry.primitives import Box
from dcap.language.offline.client import OfflineClient
from dcap.language.protocol.questions import PARTS, Question
from dcap.language.protocol.replies import PartName, PartsReply
from dcap.language.protocol.requests import PartsRequest
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.scan import Scan
from dcap.scene.types.segmentation import Segmentation
from dcap.synthetic.shapes import joined, moved
from tasks.requests.pictures import SIZE, TINT
from tasks.segment.part_names import paint, with_part_names
from tasks.segment.stage import SegmentConfig, segment, segment_object


def block(low: tuple[float, float, float], high: tuple[float, float, float]) -> Mesh:
    """A closed box."""
    a, b = np.array(low), np.array(high)
    return moved(Box(b - a).surface(0.05), *(0.5 * (a + b)))


def scan_of(mesh: Mesh, label: str) -> Scan:
    """A scan of one thing."""
    none = np.full(len(mesh.faces), -1, dtype=np.int32)
    return Scan(mesh, none, (), (), (), label, np.eye(4), "z", 1.0, "format", ())


def table(label: str = "table") -> Scan:
    """A board on two trestles."""
    top = block((-0.7, -0.4, 0.71), (0.7, 0.4, 0.75))
    legs = [block((x, -0.3, 0.0), (x + 0.06, 0.3, 0.7095)) for x in (-0.5, 0.44)]
    return scan_of(joined([top, *legs]), label)


def dumbbell() -> Scan:
    """Two heads and a bar."""
    heads = [block((x, -0.05, -0.05), (x + 0.06, 0.05, 0.05)) for x in (-0.13, 0.07)]
    return scan_of(joined([block((-0.07, -0.015, -0.015), (0.07, 0.015, 0.015)), *heads]), "dumbbell")


class Namer(OfflineClient):
    """Calls every part by one name and remembers what it was asked."""

    def __init__(self, name: str) -> None:
        self.name = name
        self.asked: list[PartsRequest] = []

    def ask(self, question: Question[Any, Any], request: Any) -> Any:
        assert question is PARTS
        self.asked.append(request)
        names = tuple(PartName(index=p.part.index, name=self.name, confidence=0.3) for p in request.parts)
        reply = PartsReply(names=names[::-1])
        reply.check(request)
        return reply


def parts_of(found: Segmentation) -> list[tuple[str, float]]:
    return [(part.name, part.confidence) for one in found.instances for part in one.parts]


def check_only_names_differ(plain: Segmentation, renamed: Segmentation, name: str) -> None:
    assert {one for one, _ in parts_of(plain)} != {name}
    assert parts_of(renamed) == [(name, 0.3)] * len(parts_of(plain))
    np.testing.assert_array_equal(renamed.face_part, plain.face_part)
    np.testing.assert_array_equal(renamed.face_instance, plain.face_instance)
    for one, other in zip(plain.instances, renamed.instances, strict=True):
        assert (one.id, one.label, one.structure) == (other.id, other.label, other.structure)
        for part, again in zip(one.parts, other.parts, strict=True):
            np.testing.assert_array_equal(part.box.corners, again.box.corners)


@pytest.mark.parametrize(("stage", "scan", "name"), [(segment, table(), "board"), (segment_object, dumbbell(), "head")])
def test_a_client_may_rename_parts(stage, scan: Scan, name: str) -> None:
    """Scene and object are asked once per thing; parts that get one name stay parts, faces and boxes stay."""
    namer = Namer(name)
    plain = stage(scan, SegmentConfig(), OfflineClient())
    check_only_names_differ(plain, stage(scan, SegmentConfig(), namer), name)
    (request,) = namer.asked
    proposed = [(p.part.name, p.confidence) for p in request.parts]
    assert proposed == parts_of(plain)
    assert {name for name, _ in proposed} | {"mattress", "headboard", "pillow", "drawer"} <= set(request.names)


def test_the_offline_reader_changes_nothing_and_draws_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    """What rules proposed comes out to the last bit, and no picture is made."""

    def drawn(*_: object) -> None:
        raise AssertionError("a picture was made")

    monkeypatch.setattr("tasks.segment.part_names.parts_picture", drawn)
    found = segment(table(), SegmentConfig(), OfflineClient())
    again = with_part_names(found, OfflineClient())
    assert [p for p, _ in parts_of(found)] == ["top", "leg"]
    assert parts_of(again) == parts_of(found)


def test_the_picture_shows_each_part_in_its_paint() -> None:
    """Top and legs are seen in hues of their own, as the request says, with white numbers on them."""
    namer = Namer("leg")
    segment(table(), SegmentConfig(), namer)
    (shown,) = namer.asked[0].pictures
    rgb = shown.make().astype(np.float64) / 255.0
    assert rgb.shape == (SIZE, SIZE, 3)
    paints = [p.paint for p in namer.asked[0].parts]
    assert paints == [paint(0), paint(1)]
    # the own colour, 200 grey, comes through as 1 - TINT of itself; light scales all channels alike
    for shade in paints:
        expected = TINT * np.array(shade) + (1.0 - TINT) * 200.0 / 255.0
        unit = rgb / np.maximum(np.linalg.norm(rgb, axis=2, keepdims=True), 1e-9)
        assert (unit @ (expected / np.linalg.norm(expected)) > 0.95).sum() > 500
    assert (rgb == 1.0).all(axis=2).sum() > 20
