"""glTF materials: base colours and their textures, and on request transparency, factors and further maps.

A missing or broken map is a note, not an error: the shape and its colour are still available. Source: Khronos, "glTF
2.0 Specification", sections 3.8 (textures) and 3.9 (materials); KHR_texture_transform.
"""

import json
from collections.abc import Callable
from dataclasses import dataclass, field
from math import isfinite
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dcap.scene.errors import InputError
from dcap.scene.readers.files import PixelBudget, read_image, read_transparent
from dcap.scene.readers.gltf.document import INCONSISTENT, Accessors, Entry, Json, entries, missing, require, uri_bytes
from dcap.scene.srgb import CLAMP, MIRROR, REPEAT, Wrap, srgb_from_linear
from dcap.scene.types.mesh import PLAIN, AlphaMode, MaterialMap, SurfaceMaterial

WRAPS = {10497: REPEAT, 33648: MIRROR, 33071: CLAMP}
"""Wrap modes of a sampler."""

LONGEST_NAME = 200
"""Maximum length of a material's name [characters]."""

OLDER = "KHR_materials_pbrSpecularGlossiness"
"""The extension that older files have instead of metalness and roughness."""


@dataclass
class PrimitiveLook:
    """Appearance of the faces of one primitive."""

    color: tuple[int, int, int]
    """Base colour (sRGB)."""
    slot: int = -1
    """Index of its base colour's texture, -1 for none."""
    material: int = 0
    """Index of its material."""
    uv_sets: dict[str, NDArray[np.float64]] = field(default_factory=dict)
    """Texture coordinates of its vertices, origin at the lower left, each (n, 2), by their source; the first are the
    base colour's."""


class GltfMaterials:
    """Collects the textures and materials of the primitives that are read."""

    def __init__(self, path: Path, document: Json, accessors: Accessors, notes: list[str], *, all_maps: bool) -> None:
        """`all_maps`: also read properties beyond the base colour."""
        self.path, self.document, self.accessors, self.notes, self.all_maps = path, document, accessors, notes, all_maps
        self.entries = entries(path, document, "materials")
        self.textures: list[NDArray[np.uint8]] = []
        self.wraps: list[Wrap] = []
        self.materials: list[SurfaceMaterial] = [PLAIN]
        self._slots: dict[tuple[int, bool, Wrap], int] = {}
        self._images: dict[tuple[int, bool], NDArray[np.uint8] | None] = {}
        self._budget = PixelBudget(path)

    def look(self, primitive: Entry, attributes: dict[str, int]) -> PrimitiveLook:
        """Base colour, texture coordinates and material of a primitive."""
        if "material" not in primitive:
            return PrimitiveLook((255, 255, 255) if "COLOR_0" in attributes else (200, 200, 200))
        material = self.entries[int(primitive["material"])]
        color, factor, texture = _base_color(material)
        look = PrimitiveLook(color)
        mode = _alpha_mode(material) if self.all_maps else AlphaMode.OPAQUE
        if texture and self._uv_set(look, attributes, texture) is not None:
            look.slot = self._slot(int(texture["index"]), transparent=mode is not AlphaMode.OPAQUE)
        if self.all_maps:
            said = self._said(material, mode, factor, lambda use: self._map(look, attributes, use))
            if said not in self.materials:
                self.materials.append(said)
            look.material = self.materials.index(said)
        return look

    def _said(
        self, material: Entry, mode: AlphaMode, factor: float, used: Callable[[object], MaterialMap | None]
    ) -> SurfaceMaterial:
        """All properties of a material beyond its base colour; `used` reads one of its maps."""
        modern = _part(material, "pbrMetallicRoughness")
        surface = used(modern.get("metallicRoughnessTexture"))
        metallic, roughness = (_share(modern.get(key)) for key in ("metallicFactor", "roughnessFactor"))
        if surface is not None or metallic is not None or roughness is not None:  # the standard fills in what is left
            metallic, roughness = (1.0 if one is None else one for one in (metallic, roughness))
        older = _part(_part(material, "extensions"), OLDER)
        if not modern and older:
            gloss = _share(older.get("glossinessFactor"))
            metallic, roughness = 0.0, None if gloss is None else 1.0 - gloss
        cutoff = material.get("alphaCutoff") if mode is AlphaMode.MASK else None
        emission = [_share(one) for one in _list(material.get("emissiveFactor"))]
        red, green, blue = ([one or 0.0 for one in emission] + [0.0] * 3)[:3]
        both = material.get("doubleSided")
        return SurfaceMaterial(
            name=_text(material.get("name")), alpha_mode=mode, alpha_cutoff=_positive(cutoff, 0.5),
            alpha=1.0 if mode is AlphaMode.OPAQUE else factor, metallic=metallic, roughness=roughness,
            emission=(red, green, blue), double_sided=both if isinstance(both, bool) else None,
            metallic_roughness_map=surface, normal_map=used(material.get("normalTexture")),
            occlusion_map=used(material.get("occlusionTexture")), emissive_map=used(material.get("emissiveTexture")),
        )  # fmt: skip

    def _map(self, look: PrimitiveLook, attributes: dict[str, int], use: object) -> MaterialMap | None:
        """A further image of the primitive's material; None if there is no usable one."""
        if not isinstance(use, dict) or "index" not in use:
            return None
        try:
            slot = self._slot(int(use["index"]), transparent=False, lost="the map is left out")
            number = None if slot < 0 else self._uv_set(look, attributes, use)
        except (InputError, *INCONSISTENT) as broken:
            self.notes.append(f"a map of a material is left out: {' '.join(str(broken).split())}")
            return None
        strength = _number(use.get("scale", use.get("strength")), 1.0)
        return None if number is None else MaterialMap(slot, number, strength)

    def _uv_set(self, look: PrimitiveLook, attributes: dict[str, int], use: Entry) -> int | None:
        """Index of the texture coordinates that a texture of a primitive uses; None if the primitive has none."""
        transform: Entry = use.get("extensions", {}).get("KHR_texture_transform", {})
        number = transform["texCoord"] if "texCoord" in transform else use.get("texCoord", 0)
        wanted = f"TEXCOORD_{int(number)}"
        if wanted not in attributes:
            return None
        key = wanted + json.dumps(transform, sort_keys=True)
        if key not in look.uv_sets:
            flat = _transformed_uv(self.accessors.read(attributes[wanted]).astype(np.float64), transform)
            look.uv_sets[key] = np.stack([flat[:, 0], 1.0 - flat[:, 1]], axis=1)
        return list(look.uv_sets).index(key)

    def _slot(self, index: int, *, transparent: bool, lost: str = "the material's colour is used") -> int:
        """Slot of a texture's decoded image; -1 if its image is missing, with a note that names the loss `lost`."""
        entry = entries(self.path, self.document, "textures")[index]
        extensions = entry.get("extensions", {})
        source = extensions.get("EXT_texture_webp", {}).get("source", entry.get("source"))
        if source is None:
            why = f" ({', '.join(sorted(extensions))})" if extensions else ""
            self.notes.append(f"texture {index} has no image that is read{why}: {lost}")
            return -1
        key = int(source), transparent, self._wrap(entry)
        if key not in self._slots:
            if key[:2] not in self._images:
                self._images[key[:2]] = self._image(int(source), transparent=transparent, lost=lost)
            image = self._images[key[:2]]
            self._slots[key] = -1 if image is None else len(self.textures)
            self.textures += [] if image is None else [image]
            self.wraps += [] if image is None else [key[2]]
        return self._slots[key]

    def _wrap(self, texture: Entry) -> Wrap:
        """Wrapping of a texture beyond its image, along u and v; repeats by default."""
        samplers = entries(self.path, self.document, "samplers")
        sampler = samplers[int(texture["sampler"])] if "sampler" in texture else {}
        along_u, along_v = (WRAPS.get(sampler.get(name, 10497), REPEAT) for name in ("wrapS", "wrapT"))
        return along_u, along_v

    def _image(self, index: int, *, transparent: bool, lost: str) -> NDArray[np.uint8] | None:
        entry = entries(self.path, self.document, "images")[index]
        where, read = f"{self.path}: image {index}", read_transparent if transparent else read_image
        if "bufferView" in entry:
            return self._budget.spend(read(self.accessors.view(int(entry["bufferView"])), where))
        uri = require(self.path, entry, "uri", str, "")
        if why := missing(self.path, uri):
            self.notes.append(f"texture {uri!r} {why}: {lost}")
            return None
        return self._budget.spend(read(uri_bytes(self.path, uri), where))


def _base_color(material: Entry) -> tuple[tuple[int, int, int], float, Entry]:
    """Base colour (sRGB), alpha and texture of a material, also in its older specular-glossiness form."""
    older: Entry = material.get("extensions", {}).get(OLDER, {})
    modern: Entry = material.get("pbrMetallicRoughness", {})
    factor = np.array(modern.get("baseColorFactor", older.get("diffuseFactor", [1, 1, 1, 1])), dtype=np.float64)
    texture = modern.get("baseColorTexture") or older.get("diffuseTexture") or {}
    red, green, blue = srgb_from_linear(factor[:3]).tolist()
    alpha = _share(float(factor[3])) if len(factor) > 3 else None
    return (red, green, blue), 1.0 if alpha is None else alpha, texture


def _alpha_mode(material: Entry) -> AlphaMode:
    """Alpha mode of a material; opaque if the standard does not define its value."""
    said = material.get("alphaMode")
    return AlphaMode(said) if said in list(AlphaMode) else AlphaMode.OPAQUE


def _part(entry: Entry, key: str) -> Entry:
    """An object within an entry, empty if it is missing."""
    found = entry.get(key)
    return found if isinstance(found, dict) else {}


def _list(value: object) -> list[object]:
    return value if isinstance(value, list) else []


def _text(value: object) -> str:
    return value[:LONGEST_NAME] if isinstance(value, str) else ""


def _number(value: object, default: float) -> float:
    """A finite number, else the default."""
    plain = isinstance(value, int | float) and not isinstance(value, bool) and isfinite(value)
    return float(value) if plain else default  # type: ignore[arg-type]


def _positive(value: object, default: float) -> float:
    return max(0.0, _number(value, default))


def _share(value: object) -> float | None:
    """A number within 0..1; None for any other value."""
    found = _number(value, -1.0) if value is not None else -1.0
    return None if found < 0.0 else min(1.0, found)


def _transformed_uv(uv: NDArray[np.float64], transform: Entry) -> NDArray[np.float64]:
    """Texture coordinates after KHR_texture_transform."""
    if not transform:
        return uv
    angle = float(transform.get("rotation", 0.0))
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    scaled = uv * np.array(transform.get("scale", [1.0, 1.0]), dtype=np.float64)
    return np.asarray(scaled @ turn.T) + np.array(transform.get("offset", [0.0, 0.0]), dtype=np.float64)
