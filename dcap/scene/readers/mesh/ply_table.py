"""Tables of PLY files: the library plyfile reads them, behind checks of what a header promises.

Guaranteed: the counts of the header are compared with the file's length before anything is allocated, which plyfile
does not do. Binary elements whose lists have three or four numbers are mapped; all others are read value by value.
Source: Greg Turk, "The PLY Polygon File Format", 1994.
"""

import re
import warnings
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from plyfile import PlyData, PlyElement, PlyElementParseError, PlyListProperty, PlyParseError

from dcap.scene.errors import FormatError
from dcap.scene.problems import Report, error, refusing
from dcap.scene.readers.files.content import read_bytes

HEADER_LIMIT = 1 << 20
"""A header longer than this is not one [bytes]."""

COUNT = re.compile(rb"(?<![^\r\n])([ \t]*element[ \t]+\S+[ \t]+)(\d+)(?=\s)")
"""The number of rows that a line of the header promises."""

END = re.compile(rb"(?<=[\r\n])end_header[ \t]*(\r\n|\n|\r)")
"""The last line of the header; a comment may hold the word too."""

WEDGE = ("texcoord", 6)
"""Texture coordinates of a triangle's corners, as some programs write them: the one usual list of another length."""

Column = NDArray[np.generic]
"""One number per row (n,), lists of one length (n, k), or lists of several: arrays in an array of objects (n,)."""

Table = dict[str, Column]


@dataclass(frozen=True, eq=False)
class PlyHeader:
    """Header of a PLY file."""

    elements: dict[str, PlyElement]
    """By name in file order, without data."""
    counts: dict[str, int]
    """Rows that each promises."""
    is_text: bool
    text: bytes
    """The header itself, in ASCII."""

    def properties(self, element: str) -> set[str]:
        """Names of an element's properties; empty where there is no such element."""
        return {p.name for p in self.elements[element].properties} if element in self.elements else set()


def read_header(path: Path) -> PlyHeader:
    """Elements, counts and encoding."""
    data = read_bytes(path, HEADER_LIMIT)
    if data[:3] != b"ply":
        raise FormatError(f"{path}: does not begin with 'ply'")
    end = END.search(data)
    if end is None:
        raise FormatError(f"{path}: the PLY header has no end_header line")
    # plyfile takes ASCII alone, but comments hold names of people and folders
    text = data[: end.end()].decode("ascii", "replace").encode("ascii", "replace")
    counts = [int(match[2]) for match in COUNT.finditer(text)]
    try:
        found = PlyData.read(BytesIO(COUNT.sub(rb"\g<1>0", text)))
    except (PlyParseError, ValueError) as broken:
        raise FormatError(f"{path}: the PLY header is not understood: {broken}") from None
    elements = {element.name: element for element in found}
    if len(elements) != len(counts):
        raise FormatError(f"{path}: the PLY header declares an element twice, or without a count")
    for prop in (p for element in found for p in element.properties):
        if isinstance(prop, PlyListProperty) and prop.len_dtype[0] == "f":
            raise FormatError(f"{path}: the length of list {prop.name!r} has a floating-point type ({prop})")
    return PlyHeader(elements, dict(zip(elements, counts, strict=True)), found.text, text)


def read_tables(path: Path, header: PlyHeader, report: Report | None = None) -> dict[str, Table]:
    """All elements by name; the file must be long enough for what its header promises.

    The first row that is broken is told to `report`, where there is one, and raised.
    """
    _check_length(path, header, path.stat().st_size - len(header.text))
    try:
        found = (None if header.is_text else _mapped(path, header)) or _by_value(path, header)
    except PlyElementParseError as broken:
        what = f"PLY {broken}" + (": the file is truncated" if "early end" in broken.message else "")
        (report or refusing(path))(error(what, line=_line(header, broken)))
        raise FormatError(f"{path}: {what}") from None
    return {element.name: {p.name: element.data[p.name] for p in element.properties} for element in found}


def _check_length(path: Path, header: PlyHeader, available: int) -> None:
    """Refuse a header that promises more than the file can hold."""
    needed = 0
    for name, element in header.elements.items():
        count, row = header.counts[name], 0
        if count and not element.properties:
            raise FormatError(f"{path}: the header declares {count} rows of element {name!r} without properties")
        for prop in element.properties:
            stored = prop.len_dtype if isinstance(prop, PlyListProperty) else prop.val_dtype
            # a text has one digit and one separator at least; an empty list still states its length
            row += 2 if header.is_text else np.dtype(stored).itemsize
        needed += count * row
        if needed > available + 1:  # the last separator of a text may be missing
            raise FormatError(
                f"{path}: the header promises {count} of element {name!r}, at least {needed} bytes "
                f"of data, but {available} follow: the file is truncated"
            )


def _line(header: PlyHeader, broken: PlyElementParseError) -> int:
    """The line of a text that is broken; 0 for binary files."""
    names = list(header.elements)
    before = sum(header.counts[name] for name in names[: names.index(broken.element.name)])
    return header.text.count(b"\n") + before + broken.row + 1 if header.is_text else 0


def _mapped(path: Path, header: PlyHeader) -> PlyData | None:
    """A binary file whose lists have the usual lengths; None where they have not."""
    for corners in (3, 4):
        lengths = {
            name: {p.name: WEDGE[1] if p.name == WEDGE[0] else corners for p in element.properties}
            for name, element in header.elements.items()
        }
        try:
            return PlyData.read(path, known_list_len=lengths)
        except PlyElementParseError as broken:
            if broken.element.name == "face" and broken.message == "early end-of-file" and corners == 3:
                raise  # every face has as many corners
        except UnicodeDecodeError:  # a header that is no ASCII
            return None
    return None


def _by_value(path: Path, header: PlyHeader) -> PlyData:
    """Any file, much slower. From memory: what a lying list asks for beyond the end is then not allocated."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)  # numpy's of empty lists
        return PlyData.read(BytesIO(header.text + read_bytes(path)[len(header.text) :]))


def scalar(path: Path, table: Table, name: str) -> Column:
    """A property of one number per vertex, shape (n,); FormatError where there is none."""
    column = table.get(name)
    if column is None or not is_scalar(column):
        raise FormatError(f"{path}: the PLY vertex element has no property {name!r} of one number")
    return np.asarray(column)


def is_scalar(column: Column) -> bool:
    """Whether the property has one number per row, not lists."""
    return column.ndim == 1 and column.dtype != np.object_


def describes_splats(header: PlyHeader) -> bool:
    """Whether a PLY header describes Gaussians rather than a mesh."""
    names = header.properties("vertex")
    return "packed_position" in names or {"f_dc_0", "opacity"} <= names
