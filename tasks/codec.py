"""Values of the pipeline as plain files, and back.

A value becomes `value.json` (structure, numbers, names) plus one file per mesh (PLY), large array (Parquet) and picture
(PNG). `value.json` refers to those files, so everything can be read without this module. Guaranteed:
equal values give equal bytes, and decoding gives back the same dtypes, shapes and numbers, bit for bit.
"""

import importlib
import io
import json
import pkgutil
from collections.abc import Mapping, Sequence
from dataclasses import fields, is_dataclass
from enum import Enum
from functools import cache
from math import isfinite, prod
from types import UnionType
from typing import Any, Union, get_args, get_origin, get_type_hints

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray
from PIL import Image

import dcap.scene.types
from dcap.scene.errors import StoreError
from dcap.scene.readers.files import MAX_PIXELS, UNREADABLE
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.outcome import Cause, Caution
from dcap.scene.writers.meshes import mesh_from_ply, mesh_to_ply
from dcap.scene.written_files import canonical_json

VALUE_FILE = "value.json"
INLINE_ITEMS = 48
"""Maximum size of an array that is written into value.json: a 4x4 matrix or an 8-corner box is easiest to read in
place."""
NAMED_COLUMNS = {1: ("value",), 2: ("x", "y"), 3: ("x", "y", "z")}
MOST_COLUMNS = 16
"""Arrays of shape (n, k) get one Parquet column per k up to this width; wider or deeper arrays are flattened."""
CHANNELS = (3, 4)
"""Channels of pictures: RGB and RGBA."""
type_hints_of = cache(get_type_hints)
"""Types of a dataclass's fields, resolved from their names once."""


def encode(value: object) -> dict[str, bytes]:
    """Return the files of a value by name; `value.json` is always among them."""
    files: dict[str, bytes] = {}
    tree = to_tree(value, "", files)
    return {VALUE_FILE: canonical_json(tree, indent=1), **files}


def decode(files: Mapping[str, bytes]) -> object:
    """Return the value from the files of `encode`."""
    return from_tree(json.loads(files[VALUE_FILE]), object, files)


@cache
def stored_types() -> dict[str, type]:
    """Return every dataclass that can be stored, by its name: files stay valid when classes move between modules."""
    modules = [f"{dcap.scene.types.__name__}.{one.name}" for one in pkgutil.iter_modules(dcap.scene.types.__path__)]
    modules += ["solver.certificate", "solver.motion"]
    found: dict[str, type] = {}
    for name in modules:
        for one in vars(importlib.import_module(name)).values():
            if isinstance(one, type) and is_dataclass(one) and one.__module__ == name:
                assert one.__name__ not in found, f"two stored types are called {one.__name__}"
                found[one.__name__] = one
    return found


def to_tree(value: object, path: str, files: dict[str, bytes]) -> object:
    """Return the JSON tree of a value; meshes, arrays and pictures go to `files` under a name made from `path`."""
    if isinstance(value, Caution):
        return {"$caution": str(value), "cause": value.cause.value}
    if value is None or isinstance(value, bool | str):
        return value.value if isinstance(value, Enum) else value
    if isinstance(value, np.ndarray):
        return array_to_tree(value, path or "array", files)
    if isinstance(value, int | np.integer | np.bool_):
        return value.item() if isinstance(value, np.generic) else int(value)
    if isinstance(value, float | np.floating):
        return float(value) if isfinite(value) else {"$float": repr(float(value))}
    if isinstance(value, Mesh):
        return {"$mesh": add_file(files, f"{path or 'mesh'}.ply", mesh_to_ply(value))}
    if is_dataclass(value) and not isinstance(value, type):
        name = type(value).__name__
        if stored_types().get(name) is not type(value):
            raise StoreError(f"{path or 'value'}: {type(value).__module__}.{name} is not among the stored types")
        items = {one.name: getattr(value, one.name) for one in fields(value)}
        return {"$type": name, **{key: to_tree(item, join(path, key), files) for key, item in items.items()}}
    if isinstance(value, Mapping):
        for key in value:
            if not isinstance(key, str) or key.startswith("$"):
                raise StoreError(f"{path or 'value'}: {key!r} cannot be a key of a stored dict")
        return {key: to_tree(item, join(path, key), files) for key, item in value.items()}
    if isinstance(value, tuple | list):
        return [to_tree(item, join(path, str(index)), files) for index, item in enumerate(value)]
    raise StoreError(f"{path or 'value'}: a {type(value).__name__} cannot be stored")


def array_to_tree(array: NDArray[np.generic], path: str, files: dict[str, bytes]) -> object:
    """Return small arrays in place, pictures as PNG, everything else as Parquet."""
    about: dict[str, object] = {"dtype": str(array.dtype), "shape": list(array.shape)}
    shaped = array.ndim == 3 and array.shape[2] in CHANNELS
    if shaped and array.dtype == np.uint8 and 0 < array.shape[0] * array.shape[1] <= MAX_PIXELS:
        buffer = io.BytesIO()
        # level 6, the default, takes two and a half times as long for 7 % fewer bytes
        Image.fromarray(np.ascontiguousarray(array)).save(buffer, "PNG", compress_level=4)
        return {"$png": add_file(files, f"{path}.png", buffer.getvalue())}
    if array.size <= INLINE_ITEMS and (array.dtype.kind != "f" or bool(np.isfinite(array).all())):
        return {"$array": array.tolist(), **about}
    return {"$parquet": add_file(files, f"{path}.parquet", array_to_parquet(array)), **about}


def from_tree(tree: object, hint: object, files: Mapping[str, bytes]) -> object:
    """Return the value of one node of the tree; `hint` is the declared type, which determines tuples and enums."""
    if isinstance(tree, dict):
        return object_from_tree(tree, hint, files)
    if isinstance(tree, list):
        return sequence_from_tree(tree, hint, files)
    kind = next((one for one in options_of(hint) if isinstance(one, type) and issubclass(one, Enum)), None)
    return kind(tree) if kind is not None and tree is not None else tree


def object_from_tree(tree: dict[str, Any], hint: object, files: Mapping[str, bytes]) -> object:
    """Return a mesh, array, picture, message, number, dataclass or plain dict."""
    if "$mesh" in tree:
        return mesh_from_ply(files[tree["$mesh"]])
    if "$png" in tree:
        return picture_from_png(files[tree["$png"]], tree["$png"])
    if "$caution" in tree:
        return Caution(Cause(tree["cause"]), tree["$caution"])
    if "$float" in tree:
        return float(tree["$float"])
    if "$array" in tree:
        return np.array(tree["$array"], dtype=tree["dtype"]).reshape(tree["shape"])
    if "$parquet" in tree:
        return array_from_parquet(files[tree["$parquet"]], tree["dtype"], tree["shape"])
    if "$type" in tree:
        kind = stored_types()[tree["$type"]]
        hints = type_hints_of(kind)
        return kind(**{key: from_tree(item, hints[key], files) for key, item in tree.items() if key != "$type"})
    arguments = get_args(hint)
    inner = arguments[1] if len(arguments) == 2 else object
    return {key: from_tree(item, inner, files) for key, item in tree.items()}


def sequence_from_tree(tree: list[object], hint: object, files: Mapping[str, bytes]) -> object:
    """Return a tuple if the field's type says so, else a list."""
    declared = next((one for one in options_of(hint) if get_origin(one) is tuple), None)
    if declared is None:
        arguments = get_args(hint)
        return [from_tree(item, arguments[0] if arguments else object, files) for item in tree]
    inner = get_args(declared)
    each = [inner[0]] * len(tree) if len(inner) == 2 and inner[1] is ... else list(inner)
    return tuple(from_tree(item, one, files) for item, one in zip(tree, each, strict=True))


def options_of(hint: object) -> tuple[object, ...]:
    """Return the types in `X | Y`, or the single type."""
    return get_args(hint) if get_origin(hint) in (Union, UnionType) else (hint,)


def join(path: str, name: str) -> str:
    """Return the file name stem of a nested field."""
    return f"{path}-{name}" if path else name


def add_file(files: dict[str, bytes], name: str, data: bytes) -> str:
    """Add one file and return its name, made safe for every file system."""
    safe = "".join(c if c.isalnum() or c in "-_." else "_" for c in name)
    while safe in files or safe == VALUE_FILE:
        safe = f"_{safe}"
    files[safe] = data
    return safe


def array_to_parquet(array: NDArray[np.generic]) -> bytes:
    """Return a table with one column per last axis of a matrix, else a single column in C order."""
    wide = array.ndim == 2 and 0 < array.shape[1] <= MOST_COLUMNS
    columns = list(array.T) if wide else [array.reshape(-1)]
    names = NAMED_COLUMNS.get(len(columns), tuple(f"c{i}" for i in range(len(columns))))
    table = pa.table([pa.array(np.ascontiguousarray(c)) for c in columns], names=list(names))
    buffer = io.BytesIO()
    pq.write_table(table, buffer, compression="zstd", use_dictionary=array.dtype.kind != "f", write_statistics=False)
    return buffer.getvalue()


def array_from_parquet(data: bytes, dtype: str, shape: Sequence[int]) -> NDArray[np.generic]:
    """Return the array that `array_to_parquet` wrote."""
    table = pq.read_table(io.BytesIO(data), use_threads=False)
    columns = [column.to_numpy(zero_copy_only=False).astype(dtype, copy=False) for column in table.itercolumns()]
    array = np.stack(columns, axis=1) if len(columns) > 1 else columns[0]
    if array.size != prod(shape):
        raise StoreError(f"a table holds {array.size} numbers, expected shape {shape}")
    return np.array(array.reshape(shape), order="C")


def picture_from_png(data: bytes, name: str) -> NDArray[np.uint8]:
    """Return the picture of a PNG; raises StoreError before decoding a pixel if it is larger than those we write."""
    try:
        with Image.open(io.BytesIO(data), formats=("PNG",)) as image:
            if image.size[0] * image.size[1] > MAX_PIXELS:
                raise StoreError(f"{name}: {image.size[0]} x {image.size[1]} pixels, at most {MAX_PIXELS}")
            return np.array(image)
    except UNREADABLE as error:
        raise StoreError(f"{name}: the picture cannot be decoded ({error})") from None
