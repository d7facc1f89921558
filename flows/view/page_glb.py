"""Surfaces as GLB files for the page: those of `dcap.scene.writers.glb`, adapted to this page.

In: `DrawnSurface`. Out: bytes. The page takes a GLB's axes unchanged (z up), overexposes unlit colours, reads vertex
colours as linear, and replaces the file's normals by averages over the faces at each vertex. That shows as an edge
where textures or borders split vertices. The wanted normals are therefore written as an active morph target.
Source: Khronos, "glTF 2.0 Specification", sections 3.7.2, 3.9 and 4.4.
"""

import copy
import json
import struct
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dcap.geometry.pieces import welded
from dcap.scene.srgb import LINEAR
from dcap.scene.types.mesh import Mesh
from dcap.scene.writers.glb import FLOAT, Node, glb_bytes
from flows.view.surface import DrawnSurface

ROUGHNESS, ALBEDO = 1.0, 0.7
"""Roughness of all surfaces; the page's own light from above would overexpose unlit colours [-]."""
SHORT = 5123
"""glTF's number of a component type, for colours with more than 8 bits."""
LEAST_TURN = 2e-3
"""Largest invisible change of a unit normal [-]."""
AT_ORIGIN = {"min": [0.0] * 3, "max": [0.0] * 3}
"""Bounds of a morph target that moves nothing: the page takes no normals without positions."""
ODD = np.array([0x9E3779B97F4A7C15 >> (3 * one) | 1 for one in range(16)], dtype=np.uint64)
"""Factors of the columns of a hash [-]."""


Document = dict[str, Any]
"""Part of the JSON document of a GLB."""


class PageSurface:
    """A surface that is encoded once and can then be sent with any positions and look."""

    def __init__(self, surface: DrawnSurface) -> None:
        mesh, corners = surface.mesh, 3 * len(surface.mesh.faces)
        self._vertex = mesh.faces.reshape(-1)
        apart = Mesh(
            np.column_stack([alike(surface), np.zeros((corners, 2))]),
            np.arange(corners, dtype=np.int32).reshape(-1, 3),
            mesh.colors[self._vertex],
        )
        data = glb_bytes([Node("surface", apart, paint=surface.paint, normals=surface.normals)])
        self._document, self._blocks = parsed(data)
        self._document.setdefault("materials", []).append({"pbrMetallicRoughness": {}})
        for one in self._primitives(self._document):
            one.setdefault("material", len(self._document["materials"]) - 1)

    def glb(self, surface: DrawnSurface, *, both_sides: bool = True) -> bytes:
        """GLB file of the same faces, perhaps moved or in other vertex colours."""
        document, blocks = copy.deepcopy(self._document), list(self._blocks)

        def put(accessor: int | None, values: NDArray[np.generic], **more: object) -> int:
            if accessor is None:
                accessor = len(document["accessors"])
                document["bufferViews"].append({"buffer": 0})
                document["accessors"].append({"bufferView": len(blocks), "count": len(values)})
                blocks.append(b"")
            entry = document["accessors"][accessor]
            blocks[entry["bufferView"]] = values.tobytes()
            entry.update(more)
            return accessor

        turns = []
        for one in self._primitives(document):
            used = one["attributes"]
            corner = self._values(used["POSITION"], "<f4", 3)[:, 0].astype(np.int64)
            points = surface.mesh.vertices[self._vertex[corner]].astype("<f4")
            put(used["POSITION"], points, min=points.min(axis=0).tolist(), max=points.max(axis=0).tolist())
            found = page_normals(points, self._values(one["indices"], "<u4", 3).astype(np.int64))
            put(used["NORMAL"], found)
            turns.append((surface.normals.reshape(-1, 3)[corner] - found).astype("<f4"))
            if "COLOR_0" in used:
                color = self._values(used["COLOR_0"], "u1", 4)[:, :3]
                if surface.paint is None:
                    color = surface.mesh.colors[self._vertex[corner]]
                light = np.full((len(corner), 4), 65535, dtype="<u2")
                light[:, :3] = np.round(65535.0 * LINEAR[color])
                put(used["COLOR_0"], light, componentType=SHORT)
        if any(np.abs(one).max() > LEAST_TURN for one in turns):
            document["meshes"][0]["weights"] = [1.0]
            for one, turn in zip(self._primitives(document), turns, strict=True):
                still = put(None, np.zeros_like(turn), componentType=FLOAT, type="VEC3", **AT_ORIGIN)
                one["targets"] = [{"POSITION": still, "NORMAL": put(None, turn, componentType=FLOAT, type="VEC3")}]
        for style in document["materials"]:
            look = style["pbrMetallicRoughness"]
            *tint, alpha = look.get("baseColorFactor", [1.0] * 4)
            look |= {"baseColorFactor": [*(ALBEDO * light for light in tint), alpha]}
            look |= {"metallicFactor": 0.0, "roughnessFactor": ROUGHNESS}
            style["doubleSided"] = both_sides
        return packed(document, blocks)

    def _values(self, accessor: int, kind: str, width: int) -> NDArray[np.generic]:
        """The rows of an accessor."""
        block = self._blocks[self._document["accessors"][accessor]["bufferView"]]
        return np.frombuffer(block, dtype=kind).reshape(-1, width)

    @staticmethod
    def _primitives(document: Document) -> list[Document]:
        return [one for mesh in document["meshes"] for one in mesh["primitives"]]


def glb_of(surface: DrawnSurface, *, both_sides: bool = True) -> bytes:
    """GLB file of a surface."""
    return PageSurface(surface).glb(surface, both_sides=both_sides)


def alike(surface: DrawnSurface) -> NDArray[np.int64]:
    """For each corner the first corner with the same vertex attributes, shape (3 m,)."""
    faces = surface.mesh.faces
    columns = [
        welded(surface.mesh.vertices)[faces].reshape(-1, 1).astype(np.uint32),
        np.ascontiguousarray(surface.normals.reshape(-1, 3)).view(np.uint32),
        surface.mesh.colors[faces].reshape(-1, 3).astype(np.uint32),
    ]
    if surface.paint is not None:
        columns += [
            np.repeat(surface.paint.texture, 3)[:, None].astype(np.uint32),
            np.ascontiguousarray(surface.paint.corner_uv.reshape(-1, 2)).view(np.uint32),
            np.ascontiguousarray(surface.paint.corner_tint.reshape(-1, 3)).view(np.uint32),
        ]
    key = np.zeros(faces.size, dtype=np.uint64)
    for number, column in enumerate(np.concatenate(columns, axis=1).T):
        key = (key ^ (key >> np.uint64(29)) ^ column) * ODD[number]
    _, first, inverse = np.unique(key, return_index=True, return_inverse=True)
    return first[inverse.reshape(-1)]


def page_normals(points: NDArray[np.float32], faces: NDArray[np.integer]) -> NDArray[np.float32]:
    """Normals that the page computes from vertices (n, 3) and faces (m, 3): area-weighted means or zero, shape (n,
    3)."""
    a, b, c = points[faces].astype(np.float64).transpose(1, 0, 2)
    normal, total = np.cross(b - a, c - a), np.zeros((len(points), 3))
    for axis in range(3):
        for corner in faces.T:
            total[:, axis] += np.bincount(corner, normal[:, axis], minlength=len(points))
    length = np.linalg.norm(total, axis=1, keepdims=True)
    unit: NDArray[np.float32] = np.divide(total, length, out=np.zeros_like(total), where=length > 0.0).astype("<f4")
    return unit


def parsed(data: bytes) -> tuple[Document, list[bytes]]:
    """The document of a GLB and the bytes of its views."""
    size = struct.unpack_from("<I", data, 12)[0]
    document, start = json.loads(data[20 : 20 + size]), 28 + size
    views = document["bufferViews"]
    return document, [data[start + one["byteOffset"] :][: one["byteLength"]] for one in views]


def packed(document: Document, blocks: list[bytes]) -> bytes:
    """A GLB of a document and the bytes of its views."""
    binary = bytearray()
    for view, block in zip(document["bufferViews"], blocks, strict=True):
        view |= {"byteOffset": len(binary), "byteLength": len(block)}
        binary += block + bytes(-len(block) % 4)
    document["buffers"] = [{"byteLength": len(binary)}]
    text = json.dumps(document, separators=(",", ":")).encode()
    text += b" " * (-len(text) % 4)
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + struct.pack("<I4s", len(binary), b"BIN\0") + binary
    return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks
