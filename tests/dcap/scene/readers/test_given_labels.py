"""Labels by hand, by vertex and by a phone are read as they are meant; what is wrong in them is one line."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from dcap.scene.errors import DcapError, InputError
from dcap.scene.readers.frame import Role
from dcap.scene.readers.labels.given import read_given_labels
from dcap.scene.readers.labels.things import up_frame
from dcap.scene.readers.source import read_scan
from dcap.scene.types.sample import SourceOptions
from dcap.scene.types.segmentation import CornerFrame, GivenLabels, VertexLabels

IDENTITY = [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]
MESH = {"faces": 10, "digest": "0123456789abcdef"}


def written(folder: Path, name: str, content: object) -> Path:
    path = folder / name
    path.write_text(content if isinstance(content, str) else json.dumps(content))
    return path


def things(*entries: dict[str, Any], **more: Any) -> dict[str, Any]:
    return {"dcap_labels": 1, "up": "z", "mesh": MESH, "things": list(entries)} | more


def labels_of(folder: Path, document: object) -> GivenLabels:
    found = read_given_labels(written(folder, "labels.json", document))
    assert isinstance(found, GivenLabels)
    return found


GUESSED = {"id": "thing_2", "label": "thing", "guess": "thing", "confidence": 0.2, "faces": [[0, 4]],
           "guesses": [["sofa", 0.2]], "parts": [{"name": "body", "faces": [[0, 4]]}]}  # fmt: skip


def test_a_label_that_a_person_changed_is_sure(tmp_path: Path) -> None:
    """Its parts are found anew; those of a guess that stands are kept."""
    left, right = labels_of(tmp_path, things(GUESSED, GUESSED | {"id": "x", "label": "Sofa", "faces": [[5, 6]]})).things
    assert (left.confidence, [part.name for part in left.parts]) == (0.2, ["body"])
    assert left.guesses == (("sofa", 0.2),)
    assert (right.label, right.confidence, right.parts, right.guesses) == ("sofa", 1.0, (), ())


def test_entries_of_one_id_are_one_thing(tmp_path: Path) -> None:
    """With the faces of both, under the label that a person gave."""
    (one,) = labels_of(tmp_path, things(GUESSED, GUESSED | {"label": "sofa", "faces": [[7, 9]]})).things
    assert (one.label, one.faces.tolist()) == ("sofa", [[0, 4], [7, 9]])


@pytest.mark.parametrize(("up", "box"), [("z", [0, 1, 2, 1, 3, 5]), ("y", [0, 1, 2, 1, 3, 5])])
def test_boxes_are_in_the_files_frame(tmp_path: Path, up: str, box: list[float]) -> None:
    """As two corners, or as centre, length, breadth, height and a turn about the upward axis."""
    x, y, z = up_frame(up)
    size = np.abs(np.stack([x, y, z]) @ [1, 2, 3])  # length, breadth and height of that box
    turned = {"center": [0.5, 2, 3.5], "size": size.tolist(), "turn_deg": 180}
    plain, other = labels_of(
        tmp_path, things({"label": "a", "box": box}, {"label": "b", "box": turned}, up=up, mesh={})
    ).things
    low, high = np.array(box).reshape(2, 3)
    for one in (plain, other):
        assert one.corners.min(axis=0) == pytest.approx(low)
        assert one.corners.max(axis=0) == pytest.approx(high)


WRONG: dict[str, tuple[object, str]] = {
    "version": ({"dcap_labels": 9, "things": [GUESSED]}, "dcap_labels is 9, expected 1"),
    "no things": (things(), "things is \\[\\], expected a list of things"),
    "no label": (things({"id": "a", "faces": [[0, 1]]}), r"thing 0 \(a\): label is missing"),
    "no place": (things({"label": "sofa"}), r"thing 0 \(sofa\): neither faces nor a box"),
    "key": (things({"label": "sofa", "boxx": [1]}), "unknown key 'boxx'; did you mean 'box'"),
    "runs": (things({"label": "sofa", "faces": [[4, 2]]}), r"faces has \[4, 2\], expected \[first, end\]"),
    "turned box": (things({"label": "sofa", "box": [1, 0, 0, 0, 1, 1]}), "lowest corner and then the highest"),
    "nan": (things({"label": "sofa", "box": [float("nan"), 0, 0, 0, 1, 1]}), "expected 6 finite numbers"),
    "size": (things({"label": "sofa", "box": {"center": [0, 0, 0], "size": [1, 0, 1]}}), "three positive lengths"),
    "confidence": (things(GUESSED | {"confidence": 3}), "confidence is 3, expected a number from 0 to 1"),
    "guesses": (things(GUESSED | {"guesses": ["sofa"]}), "expected a list of \\[label, probability\\]"),
    "digest": (things(GUESSED, mesh={}), "mesh.digest is missing"),
    "merged": (things(GUESSED | {"label": "sofa"}, GUESSED | {"label": "bed"}), "'bed' and 'sofa'; things that are"),
    "empty": ("", "the file is empty"),
    "json": ("{", "broken JSON"),
    "keys": ({"foo": 1}, "its keys are foo; expected labels.json"),
    "list": ({"vertex_instance": [0, 1.5]}, "expected a list of whole numbers"),
    "unnamed": ({"vertex_instance": [0, 1], "labels": {"7": "sofa"}}, "thing 7, which no vertex .*; there are 0, 1"),
    "nothing": ({"vertex_instance": [-1, -1]}, "all numbers are below 0"),
    "alone": ({"segIndices": [0, 1]}, r"needs one file with segGroups next to it \(\*.aggregation.json\), found none"),
    "dimensions": ({"objects": [{"category": {"sofa": {}}, "dimensions": [1, 2], "transform": IDENTITY}]},
                   "dimensions is \\[1, 2\\], expected 3 finite numbers"),
    "transform": ({"objects": [{"category": {"sofa": {}}, "dimensions": [1, 2, 1], "transform": [2.0] * 16}]},
                  "not a rotation and a shift"),
    "category": ({"objects": [{"category": 7, "dimensions": [1, 2, 1], "transform": IDENTITY}]}, "category is 7"),
}  # fmt: skip


def test_what_is_wrong_is_one_line(tmp_path: Path, subtests: pytest.Subtests) -> None:
    """Which names the file, the entry, the value and what is expected."""
    for case, (document, words) in WRONG.items():
        with subtests.test(str(case)):
            with pytest.raises(DcapError, match=words) as caught:
                read_given_labels(written(tmp_path, "labels.json", document))
            assert "\n" not in str(caught.value)
            assert "labels.json" in str(caught.value)


def test_a_phones_plan_of_a_room(tmp_path: Path) -> None:
    """Boxes in metres and y up, columns of the transform first; enums with and without values; others are told."""
    turned = [0, 0, -1, 0, 0, 1, 0, 0, 1, 0, 0, 0, 2, 0.4, 1, 1]  # a quarter turn about y, then a shift
    plan = {
        "objects": [
            {"category": {"sofa": {}}, "dimensions": [2, 0.8, 1], "transform": turned, "confidence": {"high": {}}},
            {"category": {"washerDryer": {}}, "dimensions": [0.6, 0.9, 0.6], "transform": IDENTITY},
            {"category": {"hotTub": {}}, "dimensions": [2, 1, 2], "transform": IDENTITY},
        ],
        "doors": [{"category": {"door": {"isOpen": False}}, "dimensions": [0.9, 2, 0], "transform": IDENTITY}],
        "floors": [{"dimensions": [4, 5, 0], "transform": IDENTITY}],
    }
    for document in (plan, {"rooms": [plan]}):
        found = labels_of(tmp_path, document)
        assert [one.label for one in found.things] == ["sofa", "washing machine", "hot tub", "door"] or [
            one.label for one in found.things
        ] == ["door", "sofa", "washing machine", "hot tub"]
        sofa = next(one for one in found.things if one.label == "sofa")
        assert (found.frame, found.complete) == (CornerFrame.Y_UP, False)
        assert sofa.corners.min(axis=0) == pytest.approx([1.5, 0.0, 0.0])
        assert sofa.corners.max(axis=0) == pytest.approx([2.5, 0.8, 2.0])
        assert "category 'hotTub' is not known" in found.notes[0]


SQUARE = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nv 3 0 0\nv 4 0 0\nv 4 1 0\nv 3 1 0\nf 1 2 3 4\nf 5 6 7 8\n"


@pytest.mark.parametrize("kind", ["npy", "txt", "json", "segs.json", "aggregation.json"])
def test_every_file_of_vertex_numbers_says_the_same(tmp_path: Path, kind: str) -> None:
    """Two squares, the second is the sofa; names stand in the file or beside it."""
    numbers = [-1, -1, -1, -1, 3, 3, 3, 3]
    if kind == "npy":
        np.save(tmp_path / "ids.npy", np.array(numbers))
    written(tmp_path, "ids.txt", "\n".join(map(str, numbers)) + "\n")
    written(tmp_path, "ids.json", {"vertex_instance": numbers, "labels": {"3": "Sofa"}})
    written(tmp_path, "ids.labels.json", {"3": "sofa"})
    written(tmp_path, "ids.segs.json", {"segIndices": [5, 5, 5, 5, 7, 7, 7, 7]})
    written(tmp_path, "ids.aggregation.json", {"segGroups": [{"objectId": 3, "label": "sofa", "segments": [7]}]})
    labels = read_given_labels(tmp_path / f"ids.{kind}")
    assert isinstance(labels, VertexLabels)
    assert (labels.ids, labels.labels) == (("sofa_3",), ("sofa",))
    scan = read_scan(written(tmp_path, "room.obj", SQUARE), SourceOptions(up="z"), Role.SCENE, labels=labels)
    assert scan.face_node.tolist() == [-1, -1, 0, 0]
    assert scan.node_labels == ("sofa",)


def test_vertices_that_do_not_fit_the_mesh(tmp_path: Path) -> None:
    """Counts, numbers that are none, and other files are refused with the values."""
    np.save(tmp_path / "ids.npy", np.zeros(5, int))
    labels = read_given_labels(tmp_path / "ids.npy")
    assert isinstance(labels, VertexLabels)
    with pytest.raises(InputError, match=r"ids.npy: 5 vertices, .*room.obj has 8"):
        read_scan(written(tmp_path, "room.obj", SQUARE), SourceOptions(up="z"), Role.SCENE, labels=labels)
    np.save(tmp_path / "nan.npy", np.array([0.0, np.nan]))
    np.save(tmp_path / "flat.npy", np.zeros((2, 2)))
    written(tmp_path, "words.txt", "1\nsofa\n")
    for name, words in (
        ("nan.npy", "vertex 1 has nan"), ("flat.npy", r"shape \(2, 2\)"), ("words.txt", "line 2 is 'sofa'"),
        ("room.obj", "not a file of labels"), (".", "a folder; give the file"),
    ):  # fmt: skip
        with pytest.raises(DcapError, match=words):
            read_given_labels(tmp_path / name)


def npy(shape: str, kind: str = "<i8") -> bytes:
    """A file of numpy with nothing behind its header."""
    head = f"{{'descr': '{kind}', 'fortran_order': False, 'shape': {shape}, }}".ljust(117) + "\n"
    return b"\x93NUMPY\x01\x00" + len(head).to_bytes(2, "little") + head.encode()
