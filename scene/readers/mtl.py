"""MTL material libraries: diffuse colour and diffuse texture of each material."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from scene.errors import FormatError
from scene.readers.image import read_image

GREY = (200, 200, 200)
"""Colour of a surface that names none (sRGB)."""


@dataclass
class Material:
    """One material."""

    color: tuple[int, int, int] = GREY
    texture: NDArray[np.uint8] | None = None


def read_mtl(path: Path, notes: list[str]) -> dict[str, Material]:
    """Materials by name; a missing library or image is a note, not an error: the shape is still there."""
    if not path.is_file():
        notes.append(f"{path.name} is missing: materials are ignored")
        return {}
    materials: dict[str, Material] = {}
    current = Material()
    for number, line in enumerate(path.read_text("utf-8", errors="replace").splitlines(), start=1):
        key, _, rest = line.strip().replace("\t", " ").partition(" ")
        if key == "newmtl":
            current = materials.setdefault(rest.strip(), Material())
        elif key == "Kd":
            current.color = _color(path, number, rest)
        elif key == "map_Kd":
            _attach_texture(path, rest.strip(), current, notes)
    return materials


def _color(path: Path, number: int, text: str) -> tuple[int, int, int]:
    try:
        red, green, blue = (min(255, max(0, round(float(word) * 255.0))) for word in text.split()[:3])
    except ValueError:
        raise FormatError(f"{path}: line {number}: Kd {text!r} is not three numbers") from None
    return red, green, blue


def _attach_texture(path: Path, text: str, material: Material, notes: list[str]) -> None:
    """Read the image that `map_Kd` names; options before the name are skipped."""
    candidates = (
        [path.parent / text.replace("\\", "/"), path.parent / text.split()[-1].replace("\\", "/")] if text else []
    )
    image_path = next((p for p in candidates if p.is_file()), None)
    if image_path is None:
        notes.append(f"texture {text!r} of {path.name} is missing: the material's colour is used")
        return
    material.texture = read_image(image_path.read_bytes(), str(image_path))
    material.color = (255, 255, 255)
