"""A glTF quad whose material says all that a material can say, and its images, made by formula."""

import io
import json
from pathlib import Path

import numpy as np
from mesh_files import glb
from numpy.typing import NDArray
from PIL import Image

SIDE = 8
FACTORS = {"metallicFactor": 0.25, "roughnessFactor": 0.625, "baseColorFactor": [1.0, 1.0, 1.0, 0.75]}
LIGHT, CUTOFF, SCALE, STRENGTH = [0.5, 0.25, 1.0], 0.375, 0.5, 0.875
IMAGES = ("base", "surface", "normal", "occlusion", "light")


def image(name: str) -> NDArray[np.uint8]:
    """One of the images, (8, 8, 3), that of the base colour (8, 8, 4): its left half is clear, its right half solid."""
    across, down = np.meshgrid(np.arange(SIDE), np.arange(SIDE))
    number = IMAGES.index(name)
    own = np.stack([30 * across, 30 * down, np.full_like(down, 40 * number + 10)], axis=2).astype(np.uint8)
    return np.dstack([own, np.where(across < SIDE // 2, 0, 255).astype(np.uint8)]) if name == "base" else own


def encoded(pixels: NDArray[np.uint8]) -> bytes:
    """As PNG."""
    file = io.BytesIO()
    Image.fromarray(pixels).save(file, "PNG")
    return file.getvalue()


def write_quad(path: Path, **changes: object) -> Path:
    """A unit square facing y with two sets of coordinates: the second, of the occlusion map, is turned by half a turn.

    `changes` are keys of the material, None to leave one out.
    """
    corner = np.array([[0, 0, 0], [0, 0, 1], [1, 0, 1], [1, 0, 0]], dtype="<f4")
    uv = corner[:, [0, 2]].copy()
    pieces = [
        corner.tobytes(),
        uv.tobytes(),
        (1 - uv).astype("<f4").tobytes(),
        np.array([0, 1, 2, 0, 2, 3], "<u4").tobytes(),
    ]
    pieces += [encoded(image(name)) for name in IMAGES]
    binary, views = b"", []
    for piece in pieces:
        views.append({"buffer": 0, "byteOffset": len(binary), "byteLength": len(piece)})
        binary += piece + bytes(-len(piece) % 4)
    material: dict[str, object] = {
        "name": "Leaf", "alphaMode": "MASK", "alphaCutoff": CUTOFF, "doubleSided": False,
        "pbrMetallicRoughness": FACTORS
        | {"baseColorTexture": {"index": 0}, "metallicRoughnessTexture": {"index": 1}},
        "normalTexture": {"index": 2, "scale": SCALE},
        "occlusionTexture": {"index": 3, "strength": STRENGTH, "texCoord": 1},
        "emissiveTexture": {"index": 4}, "emissiveFactor": LIGHT,
    }  # fmt: skip
    material = {key: value for key, value in (material | changes).items() if value is not None}
    kinds = [(5126, 4, "VEC3"), (5126, 4, "VEC2"), (5126, 4, "VEC2"), (5125, 6, "SCALAR")]
    accessors: list[dict[str, object]] = [
        {"bufferView": i, "componentType": kind, "count": count, "type": shape}
        for i, (kind, count, shape) in enumerate(kinds)
    ]
    accessors[0] |= {"min": [0, 0, 0], "max": [1, 0, 1]}
    document: dict[str, object] = {
        "asset": {"version": "2.0"}, "scene": 0, "scenes": [{"nodes": [0]}], "nodes": [{"name": "leaf", "mesh": 0}],
        "meshes": [{"primitives": [
            {"attributes": {"POSITION": 0, "TEXCOORD_0": 1, "TEXCOORD_1": 2}, "indices": 3, "material": 0}
        ]}],
        "materials": [material], "accessors": accessors, "bufferViews": views,
        "buffers": [{"byteLength": len(binary)}],
        "images": [{"bufferView": 4 + i, "mimeType": "image/png"} for i in range(5)],
        "samplers": [{"wrapS": 33071, "wrapT": 33648}],
        "textures": [{"source": i, "sampler": 0} if i == 2 else {"source": i} for i in range(5)],
    }  # fmt: skip
    path.write_bytes(glb(json.loads(json.dumps(document)), binary))
    return path
