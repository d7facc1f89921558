"""USD scenes (.usd, .usda, .usdc, .usdz): their meshes with transforms, instances, unit and up axis.

Needs the optional library `usd-core`. It runs in its own process with limits on time and memory, because a broken
binary can keep it busy forever. Guaranteed: a file that refers to missing files is refused, and every index is checked.
"""

import importlib.util
import io
import json
import subprocess
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dcap.packages import module_command
from dcap.scene.errors import FormatError, InputError
from dcap.scene.readers.files import PixelBudget, read_bytes, read_image
from dcap.scene.readers.mesh.raw import RawMesh
from dcap.scene.readers.usd import usd_stage
from dcap.scene.types.mesh import Paint

USD_SUFFIXES = (".usd", ".usda", ".usdc", ".usdz")

MAGIC = (b"#usda", b"PXR-USDC", b"PK\x03\x04")
"""First bytes of texts, binaries and packages."""

CPU_SECONDS = 60
"""Processor time allowed for reading [s], and as much again per 50 MB: a sound file of 20 MB takes a few seconds."""

MOST_SECONDS = 3600
"""Longest wait for it [s]: a stage may refer to a source that never ends."""

MEMORY = 4 << 30
"""Address space allowed [bytes], half of it for the library itself, and in addition a hundred times the file."""


def read_usd(path: Path) -> RawMesh:
    """Read every mesh of a stage; helpers and hidden meshes only if there are no others."""
    data = read_bytes(path)
    if not data.startswith(MAGIC):
        raise FormatError(f"{path}: not a USD file: neither text, binary nor package")
    if importlib.util.find_spec("pxr") is None:
        raise InputError(
            f"{path}: USD is read with the library usd-core, which is not installed: `pip install 'dcap[usd]'`; "
            "or export the scene as GLB"
        )
    limits = (CPU_SECONDS * (1 + len(data) // 50_000_000), MEMORY + 100 * len(data))
    try:
        done = subprocess.run(
            module_command(usd_stage.__name__, str(path), *map(str, limits)),
            capture_output=True, check=False, timeout=MOST_SECONDS,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        raise FormatError(f"{path}: the USD library did not finish within {MOST_SECONDS} s") from None
    if done.returncode == usd_stage.REFUSED:
        found = json.loads(done.stdout.splitlines()[-1])
        raise (FormatError if found["broken"] else InputError)(found["message"])
    if done.returncode:
        raise FormatError(
            f"{path}: the USD library failed on this file (exit {done.returncode}; limits {limits[0]} s, "
            f"{limits[1]} bytes)"
        )
    arrays = np.load(io.BytesIO(done.stdout), allow_pickle=False)
    notes: list[str] = []
    return RawMesh(
        path=path, vertices=arrays["vertices"], faces=arrays["faces"],
        colors=arrays.get("colors"), paint=_paint(path, arrays, notes), face_node=arrays["face_node"],
        node_names=tuple(arrays["names"].tolist()), up=str(arrays["up"]), unit_metres=float(arrays["unit_metres"]),
        notes=tuple(notes),
    )  # fmt: skip


def _paint(path: Path, arrays: Mapping[str, NDArray[np.generic]], notes: list[str]) -> Paint | None:
    """Base-colour textures; None if there are none. An image that cannot be decoded is left out."""
    if "face_texture" not in arrays:
        return None
    textures, wraps, slot, budget = [], [], [], PixelBudget(path)
    for number, (along_u, along_v) in enumerate(arrays["wraps"].tolist()):
        try:
            image = read_image(arrays[f"image_{number}"].tobytes(), f"{path}: image {number}")
            textures.append(budget.spend(image))
            wraps.append((along_u, along_v))
            slot.append(len(textures) - 1)
        except FormatError as broken:
            notes.append(f"a texture is left out: {broken}")
            slot.append(-1)
    texture = np.array([*slot, -1], dtype=np.int32)[arrays["face_texture"].astype(np.int64)]
    color = np.full((len(texture), 3), 255, dtype=np.uint8)
    return Paint(color, texture, np.nan_to_num(arrays["corner_uv"].astype(np.float64)), tuple(textures), tuple(wraps))
