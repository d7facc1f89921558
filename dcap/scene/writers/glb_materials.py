"""Materials, textures and images of a GLB file.

Equal images are written once, whatever their use; pixels are unchanged. If a source does not state how its surface
reflects, it is rough and not metallic, and both sides are visible.
Source: Khronos, "glTF 2.0 Specification", sections 3.8 and 3.9.
"""

import io
from collections.abc import Callable, Sequence
from hashlib import sha256

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from dcap.scene.srgb import CLAMP, MIRROR, REPEAT, Wrap
from dcap.scene.types.paint import CornerPaint
from dcap.scene.types.surface_material import AlphaMode, MaterialMap, SurfaceMaterial

SAMPLER = {"magFilter": 9729, "minFilter": 9987}
"""Linear, with smaller copies."""
WRAPS = {REPEAT: 10497, MIRROR: 33648, CLAMP: 33071}
METALLIC, ROUGHNESS = 0.0, 0.9
"""Factors if the source states none [-]."""
CUTOFF = 0.5
"""Default factors of the standard [-]."""

Shade = NDArray[np.float32]
"""A linear colour 0..1, shape (3,)."""
Entry = dict[str, object]


class MaterialWriter:
    """Collects the entries of the document for the look of its faces."""

    def __init__(self, add_image: Callable[[bytes], int]) -> None:
        """`add_image` stores an encoded image and returns the index of its view."""
        self._add_image = add_image
        self._images: list[Entry] = []
        self._materials: list[Entry] = []
        self._textures: list[dict[str, int]] = []
        self._samplers: list[Wrap] = []
        self._image_of: dict[bytes, int] = {}
        self._material_of: dict[str, int] = {}
        self._known: dict[int, tuple[NDArray[np.uint8], bytes]] = {}

    def material(
        self, paint: CornerPaint, said: SurfaceMaterial, texture: int | None, shade: Shade, sets: Sequence[int]
    ) -> int:
        """Index of a material from a base colour's texture, a linear colour that multiplies it, and further properties.

        `sets` are the numbers of the texture coordinates in the order of its faces.
        """
        alpha = 1.0 if said.alpha_mode is AlphaMode.OPAQUE else said.alpha
        look: Entry = {} if texture is None else {"baseColorTexture": {"index": texture}}
        look |= {
            "baseColorFactor": [*(float(one) for one in shade), alpha],
            "metallicFactor": METALLIC if said.metallic is None else said.metallic,
            "roughnessFactor": ROUGHNESS if said.roughness is None else said.roughness,
        }
        if said.metallic_roughness_map is not None:
            look["metallicRoughnessTexture"] = self._use(paint, said.metallic_roughness_map, sets)
        entry: Entry = {"name": said.name} if said.name else {}
        entry |= {"pbrMetallicRoughness": look, "doubleSided": said.double_sided is not False}
        for key, used, strength in (
            ("normalTexture", said.normal_map, "scale"),
            ("occlusionTexture", said.occlusion_map, "strength"),
            ("emissiveTexture", said.emissive_map, ""),
        ):
            if used is not None:
                entry[key] = self._use(paint, used, sets, strength)
        if any(said.emission):
            entry["emissiveFactor"] = list(said.emission)
        if said.alpha_mode is not AlphaMode.OPAQUE:
            entry["alphaMode"] = said.alpha_mode.value
        if said.alpha_mode is AlphaMode.MASK and said.alpha_cutoff != CUTOFF:
            entry["alphaCutoff"] = said.alpha_cutoff
        key = repr(entry)
        if key not in self._material_of:
            self._material_of[key] = len(self._materials)
            self._materials.append(entry)
        return self._material_of[key]

    def texture(self, image: NDArray[np.uint8], wrap: Wrap) -> int:
        """Index of the texture of an image; equal images are written once."""
        content = self._content(image)
        if content not in self._image_of:
            file = io.BytesIO()
            Image.fromarray(image).save(file, "PNG", compress_level=6)
            self._images.append({"bufferView": self._add_image(file.getvalue()), "mimeType": "image/png"})
            self._image_of[content] = len(self._images) - 1
        if wrap not in self._samplers:
            self._samplers.append(wrap)
        entry = {"source": self._image_of[content], "sampler": self._samplers.index(wrap)}
        if entry not in self._textures:
            self._textures.append(entry)
        return self._textures.index(entry)

    def entries(self) -> Entry:
        """Lists of the document, without empty ones."""
        samplers = [SAMPLER | {"wrapS": WRAPS[u], "wrapT": WRAPS[v]} for u, v in self._samplers]
        lists = {
            "materials": self._materials, "textures": self._textures, "images": self._images, "samplers": samplers
        }  # fmt: skip
        return {key: found for key, found in lists.items() if found}

    def _content(self, image: NDArray[np.uint8]) -> bytes:
        """Content of an image; computed once for each array, which is kept alive so that its id stays unique."""
        if id(image) not in self._known:
            self._known[id(image)] = image, sha256(image.tobytes()).digest() + repr(image.shape).encode()
        return self._known[id(image)][1]

    def _use(self, paint: CornerPaint, used: MaterialMap, sets: Sequence[int], strength: str = "") -> Entry:
        """Reference of a material to one of its maps."""
        entry: Entry = {"index": self.texture(paint.textures[used.texture], paint.wrap(used.texture))}
        if used.uv_set != sets[0]:
            entry["texCoord"] = list(sets).index(used.uv_set)
        return entry | ({strength: used.strength} if strength and used.strength != 1.0 else {})
