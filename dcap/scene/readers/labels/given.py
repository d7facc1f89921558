"""One door for all files of labels: a path in, the labels of things or of vertices out."""

from pathlib import Path

import numpy as np

from dcap.scene.errors import FormatError, InputError
from dcap.scene.problems import refusing, short
from dcap.scene.readers.files.json_text import read_json
from dcap.scene.readers.labels.roomplan import is_roomplan, read_roomplan
from dcap.scene.readers.labels.things import read_things
from dcap.scene.readers.labels.vertices import read_numpy, read_segments, read_text, read_vertex_list
from dcap.scene.readers.scenes.interiorgs import label_entries
from dcap.scene.readers.scenes.scannet import GROUPS, SEGMENTS
from dcap.scene.types.given_labels import CornerFrame, GivenLabels, GivenThing, VertexLabels

KNOWN = (
    "labels.json of `dcap dataset label`, vertex ids (.npy, .txt, .json), ScanNet's segs.json with aggregation.json, "
    "RoomPlan's JSON or InteriorGS' labels.json"
)


def read_given_labels(path: Path) -> GivenLabels | VertexLabels:
    """Read any of the formats; FormatError or InputError with one line where it is none or broken."""
    if path.is_dir():
        raise InputError(f"--labels {path}: a folder; give the file: {KNOWN}")
    suffix = path.suffix.lower()
    if suffix == ".npy":
        return read_numpy(path)
    if suffix == ".txt":
        return read_text(path)
    if suffix != ".json":
        raise InputError(f"--labels {path}: not a file of labels that is read ({KNOWN})")
    return _of_json(path, read_json(path))


def _of_json(path: Path, document: object) -> GivenLabels | VertexLabels:
    if isinstance(document, list) or (isinstance(document, dict) and isinstance(document.get("labels"), list)):
        return _of_interiorgs(path, document)
    if not isinstance(document, dict):
        raise FormatError(f"{path}: {short(document)} is no file of labels ({KNOWN})")
    if "dcap_labels" in document or "things" in document:
        return read_things(path, document)
    if "vertex_instance" in document:
        return read_vertex_list(path, document)
    if GROUPS in document or SEGMENTS in document:
        return read_segments(path, document)
    if is_roomplan(document):
        return read_roomplan(path, document)
    keys = ", ".join(list(map(str, document))[:6]) or "none"
    raise FormatError(f"{path}: no file of labels that is read: its keys are {keys}; expected {KNOWN}")


def _of_interiorgs(path: Path, document: object) -> GivenLabels:
    """Labelled boxes in metres and z up."""
    boxes = [one.box for one in label_entries(document, refusing(path)) if one.box is not None]
    if not boxes:
        raise FormatError(f"{path}: no labelled boxes in it")
    none = np.zeros((0, 2), np.int64)
    things = tuple(GivenThing(one.id, one.label, 1.0, none, one.box.corners) for one in boxes)
    return GivenLabels(path.name, things, CornerFrame.Z_UP, complete=False, mesh="")
