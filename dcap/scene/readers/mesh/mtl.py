"""MTL material libraries: diffuse colour and diffuse texture of each material.

What is missing or cannot be used is a note, not an error: the shape is still there.
"""

import posixpath
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dcap.scene.readers.files.image import read_image
from dcap.scene.readers.files.references import absence, beside, material_lines, texture_beside

GREY = (200, 200, 200)
"""Colour of a surface that names none (sRGB)."""


@dataclass
class MtlMaterial:
    """One material."""

    color: tuple[int, int, int] = GREY
    texture: NDArray[np.uint8] | None = None


def read_mtl(folder: Path, name: str, notes: list[str]) -> dict[str, MtlMaterial]:
    """Materials by name of the library that an OBJ in `folder` names."""
    library = beside(folder, name)
    if library is None:
        notes.append(f"{name} {absence(name)}: materials are ignored")
        return {}
    materials: dict[str, MtlMaterial] = {}
    current = MtlMaterial()
    for number, key, rest in material_lines(folder / library):
        if key == "newmtl":
            current = materials.setdefault(rest, MtlMaterial())
        elif key == "Kd":
            current.color = _color(f"{library}: line {number}", rest, notes)
        elif key == "map_Kd":
            _attach_texture(folder, library, rest, current, notes)
    return materials


def _color(where: str, text: str, notes: list[str]) -> tuple[int, int, int]:
    """Three shares of full light; grey for a colour by spectrum, which the format allows, and for anything else."""
    try:
        red, green, blue = (min(255, max(0, round(float(word) * 255.0))) for word in text.split()[:3])
    except (ValueError, OverflowError):
        notes.append(f"{where}: Kd {text!r} is not three numbers: grey is used")
        return GREY
    return red, green, blue


def _attach_texture(folder: Path, library: str, text: str, material: MtlMaterial, notes: list[str]) -> None:
    """Read the image that `map_Kd` names."""
    image = texture_beside(folder, library, text)
    if image is None:
        reason = absence(text, posixpath.dirname(library))
        notes.append(f"texture {text!r} of {library} {reason}: the material's colour is used")
        return
    material.texture = read_image((folder / image).read_bytes(), str(folder / image))
    material.color = (255, 255, 255)
