"""MTL material libraries, and their properties assigned to the faces of an OBJ.

A missing or unusable value is a note, not an error: the shape is still available. The alpha of a diffuse texture does
not count, because the format has `map_d` for that. Of the keywords for physically based rendering, `Pm`, `Pr`, `Ke`,
`map_Ke` and `norm` are read.

Properties of the materials of an OBJ beyond colours and diffuse textures, assigned to its faces.
"""

import posixpath
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from dcap.scene.errors import FormatError
from dcap.scene.readers.files import (
    MTL_TEXTURES,
    PixelBudget,
    absence,
    find_file,
    material_lines,
    read_bytes,
    read_image,
    read_transparent,
    texture_beside,
)
from dcap.scene.srgb import linear_from_srgb
from dcap.scene.types.mesh import PLAIN, AlphaMode, MaterialMap, Paint, SurfaceMaterial

GREY = (200, 200, 200)
"""Colour of a surface without a stated colour (sRGB)."""

DIFFUSE, CUTOUT, LIGHT, NORMAL = MTL_TEXTURES

Rgb = NDArray[np.uint8]


@dataclass
class MtlMaterial:
    """One material."""

    color: tuple[int, int, int] = GREY
    texture: Rgb | None = None
    """Diffuse image, with alpha if `map_d` provides it."""
    opacity: float = 1.0
    """Opacity, 0..1 [-]."""
    metallic: float | None = None
    roughness: float | None = None
    emission: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Linear emitted light, 0..1."""
    images: dict[str, Rgb] = field(default_factory=dict)
    """Further images by keyword."""

    @property
    def alpha_mode(self) -> AlphaMode:
        """Opaque, cut out (an image of only 0 and 255), or blended."""
        alpha = None if self.texture is None or self.texture.shape[2] == 3 else self.texture[..., 3]
        if self.opacity < 1.0 or (alpha is not None and not ((alpha == 0) | (alpha == 255)).all()):
            return AlphaMode.BLEND
        return AlphaMode.OPAQUE if alpha is None else AlphaMode.MASK


class MtlImages:
    """The images of a library: each is decoded once, however many materials refer to it."""

    def __init__(self, folder: Path, library: str) -> None:
        self.folder, self.library, self.budget = folder, library, PixelBudget(folder / library)
        self._known: dict[tuple[str, bool], Rgb] = {}

    def absence(self, text: str) -> str:
        """Reason why there is no image of that name."""
        return absence(text, posixpath.dirname(self.library))

    def read(self, text: str, *, transparent: bool = False) -> Rgb | None:
        """The image named in a line; None if there is none."""
        name = texture_beside(self.folder, self.library, text)
        if name is None:
            return None
        if (name, transparent) not in self._known:
            path, read = self.folder / name, read_transparent if transparent else read_image
            self._known[name, transparent] = self.budget.spend(read(read_bytes(path), str(path)))
        return self._known[name, transparent]


def read_mtl(folder: Path, name: str, notes: list[str], *, all_maps: bool = False) -> dict[str, MtlMaterial]:
    """Materials by name from the library named by an OBJ in `folder`; `all_maps`: also properties beyond colour."""
    library = find_file(folder, name)
    if library is None:
        notes.append(f"{name} {absence(name)}: materials are ignored")
        return {}
    materials: dict[str, MtlMaterial] = {}
    images = MtlImages(folder, library)
    current = MtlMaterial()
    stated: set[int] = set()
    for number, key, rest in material_lines(folder / library):
        where = f"{library}: line {number}"
        if key == "newmtl":
            current = materials.setdefault(rest, MtlMaterial())
        elif key == "Kd":
            current.color = _color(where, rest, notes)
        elif key == DIFFUSE:
            _attach_texture(images, rest, current, notes)
        elif not all_maps:
            continue
        elif key == "d":  # takes precedence over Tr, which some programs write with the same meaning
            current.opacity = _share(where, key, rest, notes, 1.0)
            stated.add(id(current))
        elif key == "Tr" and id(current) not in stated:
            current.opacity = 1.0 - _share(where, key, rest, notes, 0.0)
        elif key == "Pm":
            current.metallic = _share(where, key, rest, notes, 0.0)
        elif key == "Pr":
            current.roughness = _share(where, key, rest, notes, 1.0)
        elif key == "Ke":
            current.emission = _light(rest)
        elif key in MTL_TEXTURES:
            _attach_map(images, key, rest, current, notes)
    if not materials:
        notes.append(f"{library} has no materials: grey is used")
    for one in materials.values():
        if CUTOUT in one.images:
            _cut_out(images, one, one.images.pop(CUTOUT))
        if LIGHT in one.images and not any(one.emission):
            one.emission = (1.0, 1.0, 1.0)
    return materials


def _color(where: str, text: str, notes: list[str]) -> tuple[int, int, int]:
    """Three shares of full light; grey for a colour given by its spectrum, which the format allows, and for anything
    else."""
    try:
        red, green, blue = (min(255, max(0, round(float(word) * 255.0))) for word in text.split()[:3])
    except (ValueError, OverflowError):
        notes.append(f"{where}: Kd {text!r} is not three numbers: grey is used")
        return GREY
    return red, green, blue


def _light(text: str) -> tuple[float, float, float]:
    """Linear light from three shares, which are interpreted as sRGB like `Kd`; zeros for anything else."""
    try:
        shares = np.clip([float(word) for word in text.split()[:3]], 0.0, 1.0)
        red, green, blue = linear_from_srgb(shares * 255.0).tolist()
    except ValueError:
        return 0.0, 0.0, 0.0
    return (red, green, blue) if np.isfinite(shares).all() else (0.0, 0.0, 0.0)


def _share(where: str, key: str, text: str, notes: list[str], otherwise: float) -> float:
    """The number at the end of a line (options may precede it), within 0..1."""
    try:
        found = float(text.split()[-1])
    except (ValueError, IndexError):
        found = float("nan")
    if found != found:
        notes.append(f"{where}: {key} {text!r} is not a number: {otherwise:g} is used")
        return otherwise
    return min(1.0, max(0.0, found))


def _attach_texture(images: MtlImages, text: str, material: MtlMaterial, notes: list[str]) -> None:
    """Read the image named by `map_Kd`."""
    image = images.read(text)
    if image is None:
        notes.append(f"texture {text!r} of {images.library} {images.absence(text)}: the material's colour is used")
        return
    material.texture, material.color = image, (255, 255, 255)


def _attach_map(images: MtlImages, key: str, text: str, material: MtlMaterial, notes: list[str]) -> None:
    """Read a further image; a missing or broken image is left out."""
    try:
        image = images.read(text, transparent=key == CUTOUT)
        if image is None:
            raise FormatError(images.absence(text))
        material.images[key] = image
    except FormatError as broken:
        notes.append(f"{key} {text!r} of {images.library} is left out: {broken}")


def _cut_out(images: MtlImages, material: MtlMaterial, image: Rgb) -> None:
    """Give the diffuse texture the alpha of `map_d`: the image's own alpha if it has one, else its brightness.

    An image of a different size is resized to the texture.
    """
    alpha = image[..., 3] if image.shape[2] == 4 else np.asarray(Image.fromarray(image).convert("L"))
    if (alpha == 255).all():
        return
    own = material.texture
    if own is None:
        own = np.full((*alpha.shape, 3), 255, dtype=np.uint8)
    elif own.shape[:2] != alpha.shape:
        size = own.shape[1], own.shape[0]
        alpha = np.asarray(Image.fromarray(np.ascontiguousarray(alpha)).resize(size, Image.Resampling.BILINEAR))
    material.texture = images.budget.spend(np.dstack([own, alpha]))


def with_materials(
    paint: Paint,
    library: Mapping[str, MtlMaterial],
    line_material: NDArray[np.int32],
    names: tuple[str, ...],
    owner: NDArray[np.int64],
    has_uv: NDArray[np.bool_],
) -> Paint:
    """Paint of triangles that are parts of the face lines `owner` (m,), with the material of each line, an index into
    `names`, -1 for none. Images only apply to the triangles that have texture coordinates (m,)."""
    textures, flat, mapped = list(paint.textures), [], []
    for name in names:
        found = library.get(name, MtlMaterial())
        uses: dict[str, MaterialMap] = {}
        for keyword, image in found.images.items():
            uses[keyword] = MaterialMap(len(textures))
            textures.append(image)
        said = SurfaceMaterial(
            name=name, alpha_mode=found.alpha_mode, alpha=found.opacity, metallic=found.metallic,
            roughness=found.roughness, emission=found.emission,
        )  # fmt: skip
        flat.append(said)
        mapped.append(replace(said, normal_map=uses.get(NORMAL), emissive_map=uses.get(LIGHT)))
    materials = tuple(dict.fromkeys([PLAIN, *mapped, *flat]))
    number = {one: index for index, one in enumerate(materials)}
    with_uv, without = (np.array([number[one] for one in (*of, PLAIN)], dtype=np.int32) for of in (mapped, flat))
    face_material = line_material[owner]
    return replace(
        paint, textures=tuple(textures), face_material=np.where(has_uv, with_uv[face_material], without[face_material]),
        materials=materials,
    )  # fmt: skip
