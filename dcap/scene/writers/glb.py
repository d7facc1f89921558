"""Writes GLB files: a tree of named nodes with vertex colours or with materials and textures.

Same input, same bytes. Faces with vertex colours have no material: many readers drop the colours if there is one. A
labelled scene has one node per instance, named by its id, with its label in `extras.label`, and below it one node per
part; `dcap.scene.readers.gltf.gltf` reads the same instances and parts back. Source: Khronos, "glTF 2.0 Specification",
sections 3.5 to 3.7 and 4.4.

Materials, textures and images of a GLB file.

Equal images are written once, whatever their use; pixels are unchanged. A surface without stated reflectance is rough
and not metallic, and both its sides are visible. Source: Khronos, "glTF 2.0 Specification", sections 3.8 and 3.9.
"""

import io
import json
import struct
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from hashlib import sha256

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from dcap.arrays import Float32Array
from dcap.scene.readers.gltf.document import BINARY_CHUNK, JSON_CHUNK
from dcap.scene.srgb import CLAMP, MIRROR, REPEAT, Wrap, srgb_from_linear
from dcap.scene.types.mesh import PLAIN, AlphaMode, CornerPaint, MaterialMap, Mesh, SurfaceMaterial
from dcap.scene.types.segmentation import Segmentation

SAMPLER = {"magFilter": 9729, "minFilter": 9987}
"""Linear filters, with mipmaps."""
WRAPS = {REPEAT: 10497, MIRROR: 33648, CLAMP: 33071}
METALLIC, ROUGHNESS = 0.0, 0.9
"""Metalness and roughness if the source states none [-]."""
CUTOFF = 0.5
"""Default alpha cutoff of the standard [-]."""

Entry = dict[str, object]
GLTF_FROM_WORLD = np.array([[1.0, 0, 0, 0], [0, 0, 1.0, 0], [0, -1.0, 0, 0], [0, 0, 0, 1.0]])
"""From (x, y, z) with z up to (x, z, -y) with y up."""

FLOAT, BYTE, INDEX = 5126, 5121, 5125
"""Component types of positions, colours and indices."""

VERTICES, INDICES = 34962, 34963
"""Targets of buffer views."""

MIX = np.uint64(0x9E3779B97F4A7C15)
"""Odd number, 2^64 over the golden ratio: multiplication by it moves similar numbers far apart."""
MOST_TINTS = 32
"""Maximum number of colours that multiply one texture as separate materials; more become vertex colours."""

UNASSIGNED = "unassigned"
"""Name of the node of the faces that belong to no instance; its label is empty."""


class MaterialWriter:
    """Collects the entries of the document for the appearance of its faces."""

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
        self, paint: CornerPaint, said: SurfaceMaterial, texture: int | None, shade: Float32Array, sets: Sequence[int]
    ) -> int:
        """Index of a material from the texture of a base colour, a linear colour that multiplies it, and further
        properties.

        `sets` are the indices of the texture coordinates in the order of its faces.
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
        """Index of the texture for an image; equal images are written once."""
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
        """Encoded content of an image; computed once for each array, which is kept alive so that its id stays
        unique."""
        if id(image) not in self._known:
            self._known[id(image)] = image, sha256(image.tobytes()).digest() + repr(image.shape).encode()
        return self._known[id(image)][1]

    def _use(self, paint: CornerPaint, used: MaterialMap, sets: Sequence[int], strength: str = "") -> Entry:
        """Reference of a material to one of its maps."""
        entry: Entry = {"index": self.texture(paint.textures[used.texture], paint.wrap(used.texture))}
        if used.uv_set != sets[0]:
            entry["texCoord"] = list(sets).index(used.uv_set)
        return entry | ({strength: used.strength} if strength and used.strength != 1.0 else {})


@dataclass(frozen=True, eq=False)
class Node:
    """One node of the tree, in the world frame."""

    name: str
    mesh: Mesh | None = None
    label: str | None = None
    """Label of the instance; None: not stated."""
    children: tuple["Node", ...] = ()
    paint: CornerPaint | None = None
    """Textures of the mesh; None: vertex colours only."""
    normals: NDArray[np.float32] | None = None
    """Unit normals at the corners of the mesh's faces, shape (m, 3, 3); None: left to the reader."""
    extras: Mapping[str, object] = field(default_factory=dict)
    """Further properties of the node."""


def glb_bytes(roots: Sequence[Node]) -> bytes:
    """The file for a tree of nodes; meshes without faces are left out."""
    writer = _Writer()
    writer.document["scenes"] = [{"nodes": [writer.add(node) for node in roots]}]
    return writer.packed()


def labelled_nodes(
    segmentation: Segmentation, paint: CornerPaint | None = None, normals: NDArray[np.float32] | None = None
) -> list[Node]:
    """A node per instance with a child per part, and one for the faces of no instance; with the paint and the corner
    normals of the segmented mesh, if given."""

    def node_of(name: str, faces: NDArray[np.int64], label: str | None = None) -> Node:
        own = None if paint is None else paint.of(faces)
        bent = None if normals is None else normals[faces]
        return Node(name, segmentation.mesh.submesh(faces), label=label, paint=own, normals=bent)

    nodes = []
    for index, one in enumerate(segmentation.instances):
        mine = segmentation.face_instance == index
        used: dict[str, int] = {}
        parts = []
        for number, part in enumerate(one.parts):
            faces = np.flatnonzero(mine & (segmentation.face_part == number))
            used[part.name] = used.get(part.name, 0) + 1
            name = part.name if used[part.name] == 1 else f"{part.name}.{used[part.name]}"
            parts.append(node_of(name, faces))
        nodes.append(Node(one.id, label=one.label, children=tuple(parts)))
    rest = np.flatnonzero(segmentation.face_instance < 0)
    return nodes + ([node_of(UNASSIGNED, rest, "")] if len(rest) else [])


def in_gltf(normals: NDArray[np.float32]) -> NDArray[np.float32]:
    """Corner normals (m, 3, 3) in glTF's axes, one row per corner, of unit length to machine precision."""
    turned = normals.reshape(-1, 3).astype(np.float64) @ GLTF_FROM_WORLD[:3, :3].T
    length = np.linalg.norm(turned, axis=1, keepdims=True)
    upward = np.array([0.0, 1.0, 0.0])  # of faces without area
    return np.where(length > 0.5, turned / np.maximum(length, 1e-12), upward).astype("<f4")


@dataclass(eq=False)
class _Writer:
    """Collects the entries of the document and their binary data."""

    document: dict[str, object] = field(default_factory=lambda: {"asset": {"version": "2.0", "generator": "dcap"}})
    nodes: list[dict[str, object]] = field(default_factory=list)
    meshes: list[dict[str, object]] = field(default_factory=list)
    accessors: list[dict[str, object]] = field(default_factory=list)
    views: list[dict[str, object]] = field(default_factory=list)
    binary: bytearray = field(default_factory=bytearray)
    looks: MaterialWriter = field(init=False)

    def __post_init__(self) -> None:
        self.looks = MaterialWriter(self._add_image)

    def add(self, node: Node) -> int:
        """Append a node with its children; returns its index."""
        index = len(self.nodes)
        entry: dict[str, object] = {"name": node.name}
        self.nodes.append(entry)
        extras = {**({} if node.label is None else {"label": node.label}), **node.extras}
        if extras:
            entry["extras"] = extras
        if node.mesh is not None and len(node.mesh.faces):
            plain = node.paint is None and node.normals is None
            entry["mesh"] = self._mesh(node.name, node.mesh) if plain else self._surface(node.name, node)
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

    def _surface(self, name: str, node: Node) -> int:
        """A mesh with corner normals, one primitive for each texture, material and tint."""
        assert node.mesh is not None
        turned = node.mesh.transformed(GLTF_FROM_WORLD)
        paint = node.paint
        if paint is None:
            colors = turned.colors[turned.faces].reshape(-1, 3)
            primitives = [self._plain(turned, np.arange(len(turned.faces)), node.normals, colors)]
            self.meshes.append({"name": name, "primitives": primitives})
            return len(self.meshes) - 1
        primitives = []
        for texture, material in np.unique(np.stack([paint.texture, paint.material], axis=1), axis=0).tolist():
            mine = np.flatnonzero((paint.texture == texture) & (paint.material == material))
            tint = paint.corner_tint[mine]
            if texture < 0 and (material < 0 or paint.materials[material] == PLAIN):
                known = (
                    srgb_from_linear(tint.astype(np.float64)) if material >= 0 else turned.colors[turned.faces[mine]]
                )
                primitives.append(self._plain(turned, mine, node.normals, known.reshape(-1, 3)))
                continue
            shades, of_face = np.unique(tint[:, 0], axis=0, return_inverse=True)
            even = len(shades) <= MOST_TINTS and bool((tint == tint[:, :1]).all())
            groups = range(len(shades)) if even else [0]
            for group in groups:
                faces = mine[of_face.reshape(-1) == group] if even else mine
                shade = shades[group] if even else np.ones(3, dtype=np.float32)
                primitives.append(self._painted(turned, faces, node, paint, shade, tinted=not even))
        self.meshes.append({"name": name, "primitives": primitives})
        return len(self.meshes) - 1

    def _plain(
        self, mesh: Mesh, faces: NDArray[np.int64], normals: NDArray[np.float32] | None, colors: NDArray[np.uint8]
    ) -> dict[str, object]:
        """Faces with the colours of their corners, (3 m, 3), and without material."""
        columns = {"POSITION": mesh.vertices[mesh.faces[faces].reshape(-1)].astype("<f4")}
        if normals is not None:
            columns["NORMAL"] = in_gltf(normals[faces])
        return self._primitive(columns, colors)

    def _painted(
        self, mesh: Mesh, faces: NDArray[np.int64], node: Node, paint: CornerPaint, shade: Float32Array, *, tinted: bool
    ) -> dict[str, object]:
        """Faces with at most one texture, and one material."""
        texture, material = int(paint.texture[faces[0]]), paint.materials[max(int(paint.material[faces[0]]), 0)]
        columns = {"POSITION": mesh.vertices[mesh.faces[faces].reshape(-1)].astype("<f4")}
        sets = sorted({one.uv_set for one in material.maps} | ({0} if texture >= 0 else set()))
        for number, one in enumerate(sets):
            uv = (paint.corner_uv, *paint.more_uv)[one][faces].reshape(-1, 2)
            columns[f"TEXCOORD_{number}"] = np.stack([uv[:, 0], np.float32(1.0) - uv[:, 1]], axis=1).astype("<f4")
        if node.normals is not None:
            columns["NORMAL"] = in_gltf(node.normals[faces])
        tint = srgb_from_linear(paint.corner_tint[faces].reshape(-1, 3).astype(np.float64)) if tinted else None
        slot = None if texture < 0 else self.looks.texture(paint.textures[texture], paint.wrap(texture))
        return self._primitive(columns, tint, self.looks.material(paint, material, slot, shade, sets))

    def _primitive(
        self, columns: dict[str, NDArray[np.float32]], colors: NDArray[np.uint8] | None, material: int | None = None
    ) -> dict[str, object]:
        """Corners (3 m, k) of faces as shared vertices, with their indices."""
        rows = [np.ascontiguousarray(one).view("<u4").reshape(len(one), -1) for one in columns.values()]
        if colors is not None:
            rows.append(np.column_stack([colors, np.full(len(colors), 255, np.uint8)]).copy().view("<u4"))
        first, inverse = distinct_rows(np.concatenate(rows, axis=1))
        attributes: dict[str, int] = {}
        for name, values in columns.items():
            own = np.ascontiguousarray(values[first])
            more = {}
            if name == "POSITION":
                more = {"min": own.min(axis=0).tolist(), "max": own.max(axis=0).tolist()}
            kind = f"VEC{own.shape[1]}"
            attributes[name] = self._accessor(own.tobytes(), VERTICES, FLOAT, kind, len(own), **more)
        if colors is not None:
            data = np.column_stack([colors[first], np.full(len(first), 255, np.uint8)])
            attributes["COLOR_0"] = self._accessor(data.tobytes(), VERTICES, BYTE, "VEC4", len(data), normalized=True)
        index = inverse.astype("<u4")
        entry: dict[str, object] = {
            "attributes": attributes,
            "indices": self._accessor(index.tobytes(), INDICES, INDEX, "SCALAR", index.size),
        }
        return entry if material is None else entry | {"material": material}

    def _add_image(self, data: bytes) -> int:
        """Index of the view for an encoded image."""
        self.views.append({"buffer": 0, "byteOffset": len(self.binary), "byteLength": len(data)})
        self.binary += data + bytes(-len(data) % 4)
        return len(self.views) - 1

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
        document |= self.looks.entries()
        text = json.dumps(document, separators=(",", ":"), ensure_ascii=False).encode()
        text += b" " * (-len(text) % 4)
        chunks = struct.pack("<II", len(text), JSON_CHUNK) + text
        if self.meshes:
            chunks += struct.pack("<II", len(self.binary), BINARY_CHUNK) + bytes(self.binary)
        return struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks


def distinct_rows(rows: NDArray[np.uint32]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """First index of each distinct row (n, k), in order, and the index of each row among them, shape (n,).

    Rows are compared by a 64-bit hash of their columns, which sorts ten times as fast; on a collision the rows
    themselves are sorted.
    """
    key = np.zeros(len(rows), dtype=np.uint64)
    for column in rows.T:
        key = (key ^ column) * MIX
        key ^= key >> np.uint64(32)
    _, first, inverse = np.unique(key, return_index=True, return_inverse=True)
    if not np.array_equal(rows[first[inverse]], rows):
        _, first, inverse = np.unique(rows, axis=0, return_index=True, return_inverse=True)
    order = np.argsort(first)
    place = np.empty_like(order)
    place[order] = np.arange(len(order))
    return first[order], place[inverse.reshape(-1)]
