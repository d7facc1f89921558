"""Tables of PLY files: header and elements, ascii and binary of either byte order.

Guaranteed: the counts that the header promises are checked against the file's length before anything is allocated.
Source: Greg Turk, "The PLY Polygon File Format", 1994.
"""

import warnings
from array import array
from dataclasses import dataclass, field
from math import isfinite
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dcap.scene.errors import FormatError
from dcap.scene.problems import Report, error, refusing

TYPES = {
    "char": "i1", "int8": "i1", "uchar": "u1", "uint8": "u1", "short": "i2", "int16": "i2", "ushort": "u2",
    "uint16": "u2", "int": "i4", "int32": "i4", "uint": "u4", "uint32": "u4", "float": "f4", "float32": "f4",
    "double": "f8", "float64": "f8",
}  # fmt: skip
"""Scalar type names of the format and numpy's."""

COUNT_TYPES = {name: kind for name, kind in TYPES.items() if kind[0] != "f"}
"""Types that the length of a list may have."""

HEADER_LIMIT = 1 << 20
"""A header longer than this is not one [bytes]."""


@dataclass
class Property:
    """One property; `count_type` is set for lists."""

    name: str
    type: str
    count_type: str = ""


@dataclass
class Element:
    """One element with its properties in file order."""

    name: str
    count: int
    properties: list[Property] = field(default_factory=list)


@dataclass(frozen=True, eq=False)
class Lists:
    """A property of lists that differ in length."""

    lengths: NDArray[np.int64]
    """Numbers in each row's list, shape (n,)."""
    values: NDArray[np.generic]
    """The numbers of all lists, one after the other."""

    def __len__(self) -> int:
        return len(self.lengths)

    def of_length(self, length: int) -> tuple[NDArray[np.int64], NDArray[np.generic]]:
        """The rows (k,) whose lists have that length, and those lists (k, length)."""
        rows = np.flatnonzero(self.lengths == length)
        start = (np.cumsum(self.lengths) - self.lengths)[rows]
        return rows, self.values[start[:, None] + np.arange(length)]


Column = NDArray[np.generic] | Lists
"""One number per row (n,), lists of one length (n, k), or lists of several."""

Table = dict[str, Column]


@dataclass(frozen=True)
class Header:
    """What a file says of itself."""

    elements: list[Element]
    order: str
    """Byte order: 'ascii', '<' or '>'."""
    size: int
    """Length of the header [bytes]."""

    def element(self, name: str) -> Element | None:
        """The element of that name, if there is one."""
        return next((e for e in self.elements if e.name == name), None)


def read_header(path: Path, data: bytes) -> Header:
    """Elements and byte order."""
    if data[:3] != b"ply":
        raise FormatError(f"{path}: does not begin with 'ply'")
    end = data.find(b"end_header", 0, HEADER_LIMIT)
    line_end = data.find(b"\n", end)
    if end < 0 or line_end < 0:
        raise FormatError(f"{path}: the PLY header has no end_header line")
    elements: list[Element] = []
    order = ""
    for number, line in enumerate(data[:end].decode("latin-1").splitlines(), start=1):
        words = line.split()
        if words[:1] == ["format"]:
            order = {"ascii": "ascii", "binary_little_endian": "<", "binary_big_endian": ">"}.get(
                "".join(words[1:2]), ""
            )
        elif words[:1] in (["element"], ["property"]):
            _declare(path, number, words, elements)
    if not order:
        raise FormatError(
            f"{path}: the PLY header names no format that is ascii, binary_little_endian or binary_big_endian"
        )
    return Header(elements, order, line_end + 1)


def _declare(path: Path, number: int, words: list[str], elements: list[Element]) -> None:
    """Take in one 'element' or 'property' line of the header."""
    try:
        if words[0] == "element":
            elements.append(Element(words[1], int(words[2])))
            if elements[-1].count < 0:
                raise ValueError
        elif words[1] == "list":
            elements[-1].properties.append(Property(words[4], TYPES[words[3]], COUNT_TYPES[words[2]]))
        else:
            elements[-1].properties.append(Property(words[2], TYPES[words[1]]))
    except (IndexError, KeyError, ValueError):
        raise FormatError(f"{path}: PLY header line {number} is not understood: {' '.join(words)!r}") from None


def read_tables(path: Path, header: Header, data: bytes, report: Report | None = None) -> dict[str, Table]:
    """All elements by name; the file must be long enough for what its header promises.

    A word of an ascii file that is no number is told to `report` and counts as 0.
    """
    _check_length(path, header, len(data) - header.size)
    if header.order == "ascii":
        return _ascii(path, header.elements, _numbers(data, header.size, report or refusing(path)))
    return _binary(path, header.elements, header.order, data, header.size)


def _check_length(path: Path, header: Header, available: int) -> None:
    """Refuse a header that promises more than the file can hold."""
    needed = 0
    for element in header.elements:
        if element.count and not element.properties:
            raise FormatError(f"{path}: {element.count} of PLY element {element.name!r}, which has no property")
        row = 0
        for prop in element.properties:
            if header.order == "ascii":
                row += 2  # one digit and one separator; an empty list still states its length
            else:
                row += np.dtype(prop.count_type or prop.type).itemsize
        needed += element.count * row
        if needed > available + 1:  # the last separator of an ascii file may be missing
            raise FormatError(
                f"{path}: the header promises {element.count} of element {element.name!r}, at least {needed} bytes "
                f"of data, but {available} follow: the file is truncated"
            )


def _binary(path: Path, elements: list[Element], order: str, data: bytes, start: int) -> dict[str, Table]:
    """All elements of a binary file."""
    tables: dict[str, Table] = {}
    for element in elements:
        tables[element.name], start = _binary_element(path, element, order, data, start)
    return tables


def _binary_element(path: Path, element: Element, order: str, data: bytes, start: int) -> tuple[Table, int]:
    """One element; lists of constant length are read in one go, others row by row."""
    if not element.count:
        return {p.name: np.zeros(0) for p in element.properties}, start
    lengths = _first_lengths(path, element, order, data, start)
    fields: list[tuple[str, str] | tuple[str, str, tuple[int, ...]]] = []
    for i, prop in enumerate(element.properties):
        if prop.count_type:
            fields += [(f"n{i}", order + prop.count_type), (f"v{i}", order + prop.type, (lengths[i],))]
        else:
            fields.append((f"v{i}", order + prop.type))
    dtype = np.dtype(fields)
    end = start + dtype.itemsize * element.count
    if end <= len(data):
        rows = np.frombuffer(data, dtype=dtype, count=element.count, offset=start)
        if all((rows[f"n{i}"] == n).all() for i, n in lengths.items()):
            return {p.name: rows[f"v{i}"] for i, p in enumerate(element.properties)}, end
    if not lengths:
        raise _truncated(path, element)
    return _binary_rows(path, element, order, data, start)


def _first_lengths(path: Path, element: Element, order: str, data: bytes, start: int) -> dict[int, int]:
    """Lengths of the lists in the first row, by property index."""
    lengths: dict[int, int] = {}
    for i, prop in enumerate(element.properties):
        if prop.count_type:
            count_type = np.dtype(order + prop.count_type)
            if start + count_type.itemsize > len(data):
                raise _truncated(path, element)
            lengths[i] = int(np.frombuffer(data, count_type, 1, start)[0])
            start += count_type.itemsize + max(lengths[i], 0) * np.dtype(prop.type).itemsize
            if lengths[i] < 0 or start > len(data):
                raise _truncated(path, element)
        else:
            start += np.dtype(prop.type).itemsize
    return lengths


def _binary_rows(path: Path, element: Element, order: str, data: bytes, start: int) -> tuple[Table, int]:
    """One element whose lists differ in length."""
    types = [
        (np.dtype(order + p.count_type) if p.count_type else None, np.dtype(order + p.type)) for p in element.properties
    ]
    least = sum((count_type or value_type).itemsize for count_type, value_type in types)
    lengths = [array("q") for _ in types]
    values = [bytearray() for _ in types]
    for row in range(element.count):
        if start + (element.count - row) * least > len(data):
            raise _truncated(path, element)
        for i, (count_type, value_type) in enumerate(types):
            length = 1
            if count_type is not None:
                if start + count_type.itemsize > len(data):
                    raise _truncated(path, element)
                length = int(np.frombuffer(data, count_type, 1, start)[0])
                start += count_type.itemsize
                lengths[i].append(length)
            size = length * value_type.itemsize
            if length < 0 or start + size > len(data):
                raise _truncated(path, element)
            values[i] += data[start : start + size]
            start += size
    table: Table = {}
    for i, (prop, (count_type, value_type)) in enumerate(zip(element.properties, types, strict=True)):
        numbers = np.frombuffer(values[i], value_type)
        table[prop.name] = numbers if count_type is None else Lists(np.array(lengths[i], dtype=np.int64), numbers)
    return table, start


def _ascii(path: Path, elements: list[Element], values: NDArray[np.float64]) -> dict[str, Table]:
    """All elements of an ascii file."""
    tables: dict[str, Table] = {}
    start = 0
    for element in elements:
        tables[element.name], start = _ascii_element(path, element, values, start)
    return tables


def _numbers(data: bytes, start: int, report: Report) -> NDArray[np.float64]:
    """All numbers of a text from its byte `start` on, shape (n,)."""
    with warnings.catch_warnings():
        warnings.simplefilter("error", DeprecationWarning)  # what numpy says where it meets another word
        try:
            return np.fromstring(data[start:], dtype=np.float64, sep=" ")
        except (DeprecationWarning, ValueError):
            pass
    values = array("d")
    for number, line in enumerate(data[start:].split(b"\n"), start=data.count(b"\n", 0, start) + 1):
        for word in line.split():
            value = _number(word)
            if value is None:
                report(error(f"{word.decode('latin-1')!r} in the PLY data is no number", line=number))
            values.append(0.0 if value is None else value)
    return np.array(values, dtype=np.float64)


def _number(word: bytes) -> float | None:
    """A number as PLY has it, which is not with Python's underscores; None where it is none."""
    try:
        return None if b"_" in word else float(word)
    except ValueError:
        return None


def _ascii_element(path: Path, element: Element, values: NDArray[np.float64], start: int) -> tuple[Table, int]:
    """One element of an ascii file."""
    if not any(p.count_type for p in element.properties):
        end = start + element.count * len(element.properties)
        if end > len(values):
            raise _truncated(path, element)
        block = values[start:end].reshape(element.count, len(element.properties))
        return {p.name: block[:, i] for i, p in enumerate(element.properties)}, end
    if start + element.count * len(element.properties) > len(values):  # an empty list still states its length
        raise _truncated(path, element)
    lengths = [array("q") for _ in element.properties]
    places = [array("q") for _ in element.properties]
    for _ in range(element.count):
        for i, prop in enumerate(element.properties):
            length = 1
            if prop.count_type:
                stated = float(values[start]) if start < len(values) else -1.0
                length = int(stated) if isfinite(stated) else -1
                start += 1
            if length < 0 or start + length > len(values):
                raise _truncated(path, element)
            lengths[i].append(length)
            places[i].append(start)
            start += length
    return {
        prop.name: _gathered(values, np.array(place, dtype=np.int64), np.array(length, dtype=np.int64), prop)
        for prop, place, length in zip(element.properties, places, lengths, strict=True)
    }, start


def _gathered(
    values: NDArray[np.float64], place: NDArray[np.int64], length: NDArray[np.int64], prop: Property
) -> Column:
    """The numbers of one property that begin at `place`."""
    if not prop.count_type:
        return values[place]
    before = np.cumsum(length) - length
    return Lists(length, values[np.repeat(place - before, length) + np.arange(int(length.sum()))])


def _truncated(path: Path, element: Element) -> FormatError:
    return FormatError(
        f"{path}: the data end within element {element.name!r} ({element.count} promised): the file is truncated"
    )


def scalar(path: Path, table: Table, name: str) -> NDArray[np.generic]:
    """A property of one number per vertex, shape (n,); FormatError where there is none."""
    column = table.get(name)
    if column is None or not is_scalar(column):
        raise FormatError(f"{path}: the PLY vertex element has no property {name!r} of one number")
    return np.asarray(column)


def is_scalar(column: Column) -> bool:
    """Whether the property has one number per row, not lists."""
    return not isinstance(column, Lists) and column.ndim == 1
