"""Writes GLB files: a tree of named nodes with vertex colours, y up and metres as the standard asks.

Same input, same bytes. No material: many readers drop the vertex colours where there is one. A labelled scene has one
node per instance, named by its id, with its label in `extras.label`, and below it one node per part;
`dcap.scene.readers.gltf.gltf` gives the same instances and parts back.
Source: Khronos, "glTF 2.0 Specification", sections 3.5 to 3.7 and 4.4.
"""

import json
import struct
from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from dcap.scene.readers.gltf.document import BINARY_CHUNK, JSON_CHUNK
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.segmentation import Segmentation

GLTF_FROM_WORLD = np.array([[1.0, 0, 0, 0], [0, 0, 1.0, 0], [0, -1.0, 0, 0], [0, 0, 0, 1.0]])
"""(x, y, z) with z up to (x, z, -y) with y up."""

FLOAT, BYTE, INDEX = 5126, 5121, 5125
"""Component types of positions, colours and indices."""

VERTICES, INDICES = 34962, 34963
"""Targets of buffer views."""

UNASSIGNED = "unassigned"
"""Name of the node of the faces that belong to no instance; its label is empty."""


@dataclass(frozen=True, eq=False)
class Node:
    """One node of the tree, in the world frame."""

    name: str
    mesh: Mesh | None = None
    label: str | None = None
    """What the instance is; None: not said."""
    children: tuple["Node", ...] = ()


def glb_bytes(roots: Sequence[Node]) -> bytes:
    """The file of a tree of nodes; meshes without faces are left out."""
    writer = _Writer()
    writer.document["scenes"] = [{"nodes": [writer.add(node) for node in roots]}]
    return writer.packed()


def labelled_nodes(segmentation: Segmentation) -> list[Node]:
    """A node per instance with a child per part, and one for the faces of no instance."""
    nodes = []
    for index, one in enumerate(segmentation.instances):
        mine = segmentation.face_instance == index
        used: dict[str, int] = {}
        parts = []
        for number, part in enumerate(one.parts):
            faces = np.flatnonzero(mine & (segmentation.face_part == number))
            used[part.name] = used.get(part.name, 0) + 1
            name = part.name if used[part.name] == 1 else f"{part.name}.{used[part.name]}"
            parts.append(Node(name, segmentation.mesh.submesh(faces)))
        nodes.append(Node(one.id, label=one.label, children=tuple(parts)))
    rest = np.flatnonzero(segmentation.face_instance < 0)
    return nodes + ([Node(UNASSIGNED, segmentation.mesh.submesh(rest), label="")] if len(rest) else [])


@dataclass(eq=False)
class _Writer:
    """Collects the entries of the document and the bytes that they point into."""

    document: dict[str, object] = field(default_factory=lambda: {"asset": {"version": "2.0", "generator": "dcap"}})
    nodes: list[dict[str, object]] = field(default_factory=list)
    meshes: list[dict[str, object]] = field(default_factory=list)
    accessors: list[dict[str, object]] = field(default_factory=list)
    views: list[dict[str, object]] = field(default_factory=list)
    binary: bytearray = field(default_factory=bytearray)

    def add(self, node: Node) -> int:
        """Append a node and those below it; returns its index."""
        index = len(self.nodes)
        entry: dict[str, object] = {"name": node.name}
        self.nodes.append(entry)
        if node.label is not None:
            entry["extras"] = {"label": node.label}
        if node.mesh is not None and len(node.mesh.faces):
            entry["mesh"] = self._mesh(node.name, node.mesh)
        if node.children:
            entry["children"] = [self.add(child) for child in node.children]
        return index

    def _mesh(self, name: str, mesh: Mesh) -> int:
        turned = mesh.transformed(GLTF_FROM_WORLD)
        position = turned.vertices.astype("<f4")
        color = np.column_stack([turned.colors, np.full(len(position), 255, dtype=np.uint8)])  # rows of 4 bytes
        attributes = {
            "POSITION": self._accessor(
                position.tobytes(), VERTICES, FLOAT, "VEC3", len(position),
                min=position.min(axis=0).tolist(), max=position.max(axis=0).tolist(),
            ),
            "COLOR_0": self._accessor(color.tobytes(), VERTICES, BYTE, "VEC4", len(color), normalized=True),
        }  # fmt: skip
        faces = turned.faces.astype("<u4")
        indices = self._accessor(faces.tobytes(), INDICES, INDEX, "SCALAR", faces.size)
        self.meshes.append({"name": name, "primitives": [{"attributes": attributes, "indices": indices}]})
        return len(self.meshes) - 1

    def _accessor(self, data: bytes, target: int, component: int, kind: str, count: int, **more: object) -> int:
        view: dict[str, object] = {
            "buffer": 0,
            "byteOffset": len(self.binary),
            "byteLength": len(data),
            "target": target,
        }
        self.binary += data  # every value takes a multiple of four bytes, so all stay aligned
        self.views.append(view)
        self.accessors.append(
            {"bufferView": len(self.views) - 1, "componentType": component, "count": count, "type": kind, **more}
        )
        return len(self.accessors) - 1

    def packed(self) -> bytes:
        """The container: the document, then the bytes."""
        document = {
            **self.document, "scene": 0, "nodes": self.nodes, "meshes": self.meshes, "accessors": self.accessors,
            "bufferViews": self.views, "buffers": [{"byteLength": len(self.binary)}],
        }  # fmt: skip
        if not self.meshes:  # lists must not be empty
            document = {key: document[key] for key in ("asset", "scene", "scenes", "nodes")}
        text = json.dumps(document, separators=(",", ":"), ensure_ascii=False).encode()
        text += b" " * (-len(text) % 4)
        chunks = struct.pack("<II", len(text), JSON_CHUNK) + text
        if self.meshes:
            chunks += struct.pack("<II", len(self.binary), BINARY_CHUNK) + bytes(self.binary)
        return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks
