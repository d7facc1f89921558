"""Labels that a person corrected divide a scene: names, merging, deleting and boxes for what was missed."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from box_rooms import bedroom
from scans import scan_of

from dcap.language.offline.client import OfflineClient
from dcap.scene.errors import InputError
from dcap.scene.readers.labels.given import read_given_labels
from dcap.scene.types.segmentation import GivenLabels, SegmentedScene
from dcap.scene.writers.labels import FoundThing, labels_text, labels_tree
from tasks.segment.stage import SegmentConfig, segment

ROOM = bedroom()
SCAN = scan_of(ROOM, up="y", unit=0.5)
Document = dict[str, Any]


def document() -> Document:
    """labels.json of the room, as it is written."""
    found = [
        FoundThing(i + 1, i, one.id, one.label, 0.5, one.structure, (1.0, 1.0, 1.0), None)
        for i, one in enumerate(ROOM.instances)
    ]
    return json.loads(labels_text(labels_tree(SCAN, ROOM, found, "room.glb")))


def divided(folder: Path, change: Callable[[Document], object], faces: bool = True) -> SegmentedScene:
    """The scene by a changed file; without its faces by its boxes alone."""
    tree = document()
    change(tree)
    if not faces:
        tree["mesh"]["digest"] = "of another"
    (folder / "labels.json").write_text(json.dumps(tree))
    labels = read_given_labels(folder / "labels.json")
    assert isinstance(labels, GivenLabels)
    return segment(SCAN, SegmentConfig(), OfflineClient(), labels)


def named(tree: Document, name: str) -> Document:
    return next(one for one in tree["things"] if one["id"] == name)


@pytest.mark.parametrize("faces", [True, False])
def test_what_is_written_is_read_as_it_was(tmp_path: Path, faces: bool) -> None:
    """By faces exactly; by boxes, of another mesh, too, which is told."""
    scene = divided(tmp_path, lambda tree: None, faces)
    for one in ROOM.instances:
        if not one.structure:
            mine = scene.face_instance == scene.index_of(one.id)
            assert np.array_equal(mine, ROOM.face_instance == ROOM.index_of(one.id)), one.id
    if faces:
        bed = scene.instances[scene.index_of("bed")]
        assert sorted(p.name for p in bed.parts) == ["frame", "headboard", "mattress", "pillow", "pillow"]
        assert bed.confidence == 0.5
    else:
        assert "made for another mesh" in scene.notes[0]


def test_a_deleted_thing_is_nothing(tmp_path: Path) -> None:
    """Its faces belong to nobody."""
    scene = divided(tmp_path, lambda tree: tree["things"].remove(named(tree, "lamp")))
    assert "lamp" not in [one.id for one in scene.instances]
    assert (scene.face_instance[ROOM.face_instance == ROOM.index_of("lamp")] == -1).all()


def test_merged_things(tmp_path: Path) -> None:
    """Two entries of one id and label have the faces of both."""
    scene = divided(tmp_path, lambda tree: named(tree, "lamp").update(id="table", label="table"))
    mine = scene.face_instance == scene.index_of("table")
    both = np.isin(ROOM.face_instance, [ROOM.index_of("lamp"), ROOM.index_of("table")])
    assert np.array_equal(mine, both)


def test_a_box_for_what_was_missed(tmp_path: Path) -> None:
    """In the file's axes and unit (y up, half metres); it takes what nobody named, not the floor."""

    def change(tree: Document) -> None:
        named(tree, "table").update(label="thing", guess="thing", confidence=0.0)
        # world 1.55..2.45, 0.55..1.45, -0.05..0.51 m
        tree["things"].append({"label": "side table", "box": [3.1, -0.1, -2.9, 4.9, 1.02, -1.1]})

    scene = divided(tmp_path, change)
    mine = scene.face_instance == scene.index_of("side_table")
    assert mine[ROOM.face_instance == ROOM.index_of("table")].all()
    assert not mine[ROOM.face_instance == ROOM.index_of("floor")].any()
    assert "lamp" in [one.id for one in scene.instances]


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (
            lambda tree: named(tree, "lamp").update(faces=[[0, 2]]),
            "face 0 is of 'bed' and of 'lamp'; give both the same id",
        ),
        (lambda tree: named(tree, "lamp").update(faces=[[0, 10**6]]), "lamp has face 999999, the mesh has"),
    ],
)
def test_faces_that_cannot_be(tmp_path: Path, change: Callable[[Document], object], words: str) -> None:
    """Two things of one face, faces that there are not."""
    with pytest.raises(InputError, match=words):
        divided(tmp_path, change)


def plan(*objects: tuple[str, tuple[float, float, float], tuple[float, float, float]]) -> Document:
    """A phone's plan: category, middle and size in metres and y up."""
    rows = [
        {
            "category": {kind: {}},
            "dimensions": list(size),
            "transform": [1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0, *middle, 1],
        }
        for kind, middle, size in objects
    ]
    return {"objects": rows}


def test_a_phones_boxes_name_what_they_hold(tmp_path: Path) -> None:
    """The bed by its box, whatever the unit of the mesh's file; the rest by its shape."""
    path = tmp_path / "room.json"
    path.write_text(json.dumps(plan(("bed", (0, 0.5, 0), (1.7, 1.1, 2.2)), ("table", (30, 0.4, 0), (1, 0.8, 1)))))
    labels = read_given_labels(path)
    assert isinstance(labels, GivenLabels)
    scene = segment(SCAN, SegmentConfig(), OfflineClient(), labels)
    bed = scene.face_instance == next(i for i, one in enumerate(scene.instances) if one.label == "bed")
    assert np.array_equal(bed, ROOM.face_instance == ROOM.index_of("bed"))
    assert "nothing of the scene is in the box of table" in " ".join(scene.notes)
    assert any(one.structure for one in scene.instances)
    path.write_text(json.dumps(plan(("sofa", (30, 0.4, 0), (1, 0.8, 1)))))
    labels = read_given_labels(path)
    assert isinstance(labels, GivenLabels)
    with pytest.raises(InputError, match="none of its 1 boxes holds anything"):
        segment(replace(SCAN), SegmentConfig(), OfflineClient(), labels)
