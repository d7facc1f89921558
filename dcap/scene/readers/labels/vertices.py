"""The thing of each vertex: numbers as .npy or .txt, or JSON; ScanNet's segments with their groups.

`.npy`: whole numbers of shape (n,). `.txt`: one per line. `.json`: `{"vertex_instance": [...], "labels": {...}}`.
Numbers below 0 are nothing. Names are `{"3": "sofa"}`; those for `.npy` and `.txt` stand next to them, in
`NAME.labels.json`.
`*.segs.json` and `*.aggregation.json` of ScanNet go together; either may be named.
"""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dcap.scene.errors import FormatError
from dcap.scene.given_text import short_name
from dcap.scene.problems import refusing, short
from dcap.scene.readers.files.content import read_bytes
from dcap.scene.readers.files.json_text import read_json
from dcap.scene.readers.scenes.scannet import GROUPS, SEGMENTS, instances_of, segments_of, vertex_instances
from dcap.scene.types.given_labels import VertexLabels

Index = NDArray[np.int64]

LARGEST = 2**31
"""Numbers of things are smaller [-]."""
LONGEST_NUMBER = 30
"""Characters of a number's line [-]."""
MAGIC = b"\x93NUMPY"
"""How a file of one array begins; archives and pickles begin otherwise."""
BROKEN_ARRAY = (ValueError, EOFError, SyntaxError, OverflowError, MemoryError, RecursionError)
"""Errors that numpy raises for bytes that are no array."""
SHOWN = 200
"""Characters of what numpy says that are shown."""


def read_numpy(path: Path) -> VertexLabels:
    """A file of numpy."""
    if read_bytes(path, len(MAGIC)) != MAGIC:
        raise FormatError(f"{path}: not an array of numpy: it does not begin as one")
    try:
        # mapped: what a header promises is compared with the file before memory is taken for it
        array = np.load(path, mmap_mode="r", allow_pickle=False)
    except (*BROKEN_ARRAY, OSError) as broken:
        raise FormatError(f"{path}: cannot be read as an array of numpy: {one_line(broken)}") from None
    if not isinstance(array, np.ndarray) or array.ndim != 1:
        raise FormatError(f"{path}: an array of shape {getattr(array, 'shape', ())}, expected one number per vertex")
    return named(path, whole(path, array), names_beside(path))


def one_line(error: Exception) -> str:
    """Message of numpy's error in one line."""
    return " ".join(str(error).split())[:SHOWN]


def read_text(path: Path) -> VertexLabels:
    """One number per line."""
    rows = read_bytes(path).decode("utf-8", "replace").split("\n")
    while rows and not rows[-1].strip():
        rows.pop()
    for number, row in enumerate(rows, start=1):
        if not row.strip().removeprefix("-").isdecimal() or len(row) > LONGEST_NUMBER:
            raise FormatError(f"{path}: line {number} is {short(row)}, expected the whole number of a vertex's thing")
    return named(path, whole(path, np.array([int(row) for row in rows], dtype=np.float64)), names_beside(path))


def read_vertex_list(path: Path, document: Mapping[str, object]) -> VertexLabels:
    """`vertex_instance` and `labels` of a JSON document."""
    values = document.get("vertex_instance")
    if not isinstance(values, list) or not all(type(one) is int for one in values):
        raise FormatError(f"{path}: vertex_instance is {short(values)}, expected a list of whole numbers")
    numbers = np.array([min(max(one, -LARGEST), LARGEST) for one in values], dtype=np.float64)
    return named(path, whole(path, numbers), names_of(path, document.get("labels", {})))


def read_segments(path: Path, document: Mapping[str, object]) -> VertexLabels:
    """ScanNet's two files, one of which is given."""
    groups_given = GROUPS in document
    wanted = SEGMENTS if groups_given else GROUPS
    end = ".segs.json" if groups_given else ".aggregation.json"
    beside = sorted(one for one in path.parent.glob(f"*{end}"))
    scene = path.name.split(".")[0].removesuffix("_vh_clean_2").removesuffix("_vh_clean")
    mine = [one for one in beside if one.name.startswith(scene)] or beside
    named_there = Path(str(document.get("segmentsFile") or "")).name
    mine = [one for one in mine if one.name == named_there] or mine
    if len(mine) != 1:
        listed = ", ".join(one.name for one in mine) or "none"
        raise FormatError(f"{path}: needs one file with {wanted} beside it (*{end}), found {listed}")
    other = read_json(mine[0])
    groups, segments = (document, other) if groups_given else (other, document)
    group_path, segment_path = (path, mine[0]) if groups_given else (mine[0], path)
    instances, skipped = instances_of(groups, segment_path.name, refusing(group_path))
    segment = segments_of(segments, None, refusing(segment_path))
    owner = vertex_instances(segment, instances, refusing(group_path))
    notes = (f"{skipped} segGroups of {group_path.name} without a label or segments are skipped",) if skipped else ()
    ids, labels = tuple(one.name for one in instances), tuple(one.label for one in instances)
    return VertexLabels(path.name, owner.astype(np.int32), ids, labels, notes)


def whole(path: Path, values: NDArray[np.generic]) -> Index:
    """Numbers of things, shape (n,)."""
    if not len(values):
        raise FormatError(f"{path}: no vertices")
    array = np.asarray(values)
    if array.dtype.kind not in "iuf":
        raise FormatError(f"{path}: values of type {array.dtype}, expected whole numbers")
    numbers = array.astype(np.float64)
    bad = np.flatnonzero(~((numbers == np.floor(numbers)) & (np.abs(numbers) < LARGEST)))
    if len(bad):
        raise FormatError(f"{path}: vertex {bad[0]} has {numbers[bad[0]]:g}, expected the whole number of its thing")
    return numbers.astype(np.int64)


def names_beside(path: Path) -> dict[int, str]:
    """The names in NAME.labels.json; none where there is no such file."""
    beside = path.with_suffix(".labels.json")
    return names_of(beside, read_json(beside)) if beside.is_file() else {}


def names_of(path: Path, document: object) -> dict[int, str]:
    """Names by number."""
    if not isinstance(document, dict):
        raise FormatError(
            f'{path}: labels are {short(document)}, expected names by number, for example {{"3": "sofa"}}'
        )
    names = {}
    for key, name in document.items():
        if not str(key).isdecimal() or len(key) > LONGEST_NUMBER or not isinstance(name, str):
            raise FormatError(f"{path}: label {short(key)}: {short(name)}; expected names by number")
        names[int(key)] = short_name(" ".join(name.lower().replace("/", " ").split()))
    return names


def named(path: Path, numbers: Index, names: Mapping[int, str]) -> VertexLabels:
    """Vertices with the names of their things."""
    known, place = np.unique(numbers, return_inverse=True)
    kept = known[known >= 0]
    if not len(kept):
        raise FormatError(f"{path}: no vertex belongs to a thing: all numbers are below 0")
    gone = sorted(set(names) - set(kept.tolist()))
    if gone:
        raise FormatError(f"{path}: labels name thing {gone[0]}, which no vertex belongs to; there are {listing(kept)}")
    labels = [names.get(int(one), "") for one in kept]
    ids = tuple(f"{label.replace(' ', '_') or 'thing'}_{one}" for one, label in zip(kept, labels, strict=True))
    instance = np.where(known >= 0, np.cumsum(known >= 0) - 1, -1)[place.reshape(-1)]
    unnamed = labels.count("")
    notes = (f"{path.name} gives no name to {unnamed} of its {len(labels)} things",) if unnamed else ()
    return VertexLabels(path.name, instance.astype(np.int32), ids, tuple(labels), notes)


def listing(numbers: Index) -> str:
    """A few numbers."""
    shown = ", ".join(str(one) for one in numbers[:8])
    return f"{shown} ..." if len(numbers) > 8 else shown
