"""glTF accessors: typed views into buffers, checked against the bytes that are there before they are read."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dcap.scene.errors import FormatError, InputError
from dcap.scene.problems import Report, error
from dcap.scene.readers.gltf.document import Json, entries
from dcap.scene.readers.mesh.raw import MAX_CORNERS

COMPONENTS = {5120: "i1", 5121: "u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
LARGEST = {5120: 127.0, 5121: 255.0, 5122: 32767.0, 5123: 65535.0, 5125: 4294967295.0}
"""The integer that a normalised accessor maps to one."""

WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4, "MAT2": 4, "MAT3": 9, "MAT4": 16}

INCONSISTENT = (LookupError, TypeError, ValueError, AttributeError, OverflowError)
"""Errors that contradictory entries raise."""


class Accessors:
    """The accessors of one document over its loaded buffers."""

    def __init__(self, path: Path, document: Json, buffers: list[bytes], report: Report) -> None:
        self.path, self.buffers = path, buffers
        self.entries = entries(path, document, "accessors")
        self.views = entries(path, document, "bufferViews")
        self.broken: set[int] = set()
        for index in range(len(self.entries)):
            try:
                self._check(index)
            except (InputError, *INCONSISTENT) as broken:
                self.broken.add(index)
                what = str(broken if isinstance(broken, InputError) else self._inconsistent(index, broken))
                report(error(what.removeprefix(f"{path}: "), ("accessors", index)))

    def _inconsistent(self, index: int, cause: Exception) -> FormatError:
        return FormatError(f"{self.path}: accessor {index} is inconsistent ({type(cause).__name__}: {cause})")

    def view(self, index: int) -> bytes:
        """The bytes of one buffer view."""
        view = self.views[index]
        start, length = int(view.get("byteOffset", 0)), int(view["byteLength"])
        data = self.buffers[int(view["buffer"])]
        if start < 0 or length < 0 or start + length > len(data):
            raise FormatError(
                f"{self.path}: buffer view {index} ends at byte {start + length}, its buffer has {len(data)}"
            )
        return data[start : start + length]

    def read(self, index: int) -> NDArray[np.generic]:
        """The values of one accessor, shape (count, width); normalised integers become floats."""
        try:
            if index < 0 or index in self.broken:  # told before; what it promises is not to be allocated
                raise FormatError(f"{self.path}: accessor {index} is broken")
            return self._read(index)
        except INCONSISTENT as broken:
            raise self._inconsistent(index, broken) from None

    def _read(self, index: int) -> NDArray[np.generic]:
        entry = self.entries[index]
        dtype, width, count = np.dtype(COMPONENTS[entry["componentType"]]), WIDTHS[entry["type"]], int(entry["count"])
        if "bufferView" in entry:
            values = self._strided(entry, dtype, width, count)
        else:
            values = np.zeros((count, width), dtype=dtype)
        if "sparse" in entry:
            values = self._with_sparse(values, entry["sparse"], dtype, width)
        if entry.get("normalized") and dtype.kind != "f":
            # glTF 2.0, section 3.6.2.2: f = max(c / (2^(b-1) - 1), -1), f = c / (2^b - 1).
            return np.asarray(np.maximum(values.astype(np.float64) / LARGEST[entry["componentType"]], -1.0))
        return values

    def _strided(
        self, entry: dict[str, int], dtype: np.dtype[np.generic], width: int, count: int
    ) -> NDArray[np.generic]:
        view = self.views[entry["bufferView"]]
        data, start = self.view(entry["bufferView"]), int(entry.get("byteOffset", 0))
        row = dtype.itemsize * width
        stride = int(view.get("byteStride", row))
        return np.ndarray((count, width), dtype, data, start, (stride, dtype.itemsize)).copy()

    def _with_sparse(
        self, values: NDArray[np.generic], sparse: dict[str, dict[str, int]], dtype: np.dtype[np.generic], width: int
    ) -> NDArray[np.generic]:
        count = int(sparse["count"])  # type: ignore[call-overload]
        indices, replacement = sparse["indices"], sparse["values"]
        at = np.frombuffer(
            self.view(indices["bufferView"]), COMPONENTS[indices["componentType"]], count, indices.get("byteOffset", 0)
        )
        new = np.frombuffer(
            self.view(replacement["bufferView"]), dtype, count * width, replacement.get("byteOffset", 0)
        )
        values[at] = new.reshape(count, width)
        return values

    def _check(self, index: int) -> None:
        """Refuse an accessor that reaches beyond its bytes, or that would allocate zeros without bound."""
        entry = self.entries[index]
        count = int(entry["count"])
        row = np.dtype(COMPONENTS[entry["componentType"]]).itemsize * WIDTHS[entry["type"]]
        available = sum(map(len, self.buffers))
        if count < 0 or ("bufferView" not in entry and count * row > 64 * available + 4096):
            raise FormatError(f"{self.path}: accessor {index} promises {count} values without data")
        if count > MAX_CORNERS:
            raise InputError(
                f"{self.path}: accessor {index} has {count} values > {MAX_CORNERS}; decimate the mesh first"
            )
        if "bufferView" not in entry:
            return
        view = self.views[int(entry["bufferView"])]
        stride = int(view.get("byteStride", row))
        end = int(entry.get("byteOffset", 0)) + (count - 1) * stride + row if count else 0
        length = len(self.view(int(entry["bufferView"])))
        if stride < row or end > length:
            raise FormatError(
                f"{self.path}: accessor {index} promises {count} values ({end} bytes), its view has {length} bytes"
            )
