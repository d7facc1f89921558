"""glTF 2.0 meshes (.glb, .gltf): the node tree, positions of vertices, triangles and their appearance.

Guaranteed: compressed files are refused by name, and every accessor is checked against its buffer before it is decoded.
Source: Khronos, "glTF 2.0 Specification", sections 3.5 (nodes), 3.6 (accessors), 3.7 (geometry), 4 (GLB).

Positions of the vertices of a glTF node: its transform, copies, morph targets and skin.

Source: Khronos, "glTF 2.0 Specification", sections 3.5.2 (transforms), 3.7.2.2 (morph targets), 3.7.3 (skins);
EXT_mesh_gpu_instancing.
"""

from functools import cached_property
from itertools import zip_longest
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from dcap.arrays import Array
from dcap.scene.errors import FormatError, InputError, format_error
from dcap.scene.readers.files import read_bytes
from dcap.scene.readers.gltf.document import (
    INCONSISTENT,
    Accessors,
    Entry,
    Json,
    binary_chunk,
    entries,
    read_document,
    require,
    uri_bytes,
)
from dcap.scene.readers.gltf.materials import GltfMaterials
from dcap.scene.readers.mesh.raw import RawMesh, check_face_count, check_vertex_count
from dcap.scene.text import short_name
from dcap.scene.types.mesh import Paint

INSTANCING = "EXT_mesh_gpu_instancing"
VISIBILITY = "KHR_node_visibility"
DEEPEST_NODE = 256
"""Maximum depth of the node tree: far above any real scene, far below Python's recursion limit."""
COMPRESSED = {
    "KHR_draco_mesh_compression": "`gltf-transform copy in.glb out.glb`",
    "EXT_meshopt_compression": "`gltf-transform copy in.glb out.glb`, or pack again with gltfpack without -c",
    "KHR_meshopt_compression": "`gltf-transform copy in.glb out.glb`, or pack again with gltfpack without -c",
}
"""Extensions that hide the geometry, with the way to decode each."""

UNDERSTOOD = {
    "KHR_mesh_quantization", "KHR_texture_transform", "KHR_materials_unlit", "EXT_texture_webp",
    "KHR_materials_specular", "KHR_materials_ior", "KHR_materials_clearcoat", "KHR_materials_transmission",
    "KHR_materials_volume", "KHR_lights_punctual", "KHR_materials_sheen", "KHR_materials_emissive_strength",
    "KHR_materials_variants", "KHR_materials_pbrSpecularGlossiness", "KHR_materials_iridescence",
    "KHR_materials_anisotropy", "KHR_xmp_json_ld", "KHR_materials_dispersion", "KHR_materials_diffuse_transmission",
    "EXT_mesh_gpu_instancing", "KHR_node_visibility", "KHR_texture_basisu", "EXT_texture_avif", "MSFT_texture_dds",
}  # fmt: skip
"""Extensions that we read, that change neither shape nor base colour, or whose loss is reported where they are used."""


def local_matrix(node: Entry) -> Array:
    """The transform parent_from_node of a node, from its matrix or its translation, rotation and scale, shape (4,
    4)."""
    if "matrix" in node:
        return np.array(node["matrix"], dtype=np.float64).reshape(4, 4).T
    rotation = Rotation.from_quat(np.array(node.get("rotation", [0, 0, 0, 1]), dtype=np.float64)).as_matrix()
    matrix = np.eye(4)
    matrix[:3, :3] = rotation * np.array(node.get("scale", [1, 1, 1]), dtype=np.float64)
    matrix[:3, 3] = np.array(node.get("translation", [0, 0, 0]), dtype=np.float64)
    return matrix


def is_hidden(node: Entry) -> bool:
    """Return whether a node, with all nodes below it, is hidden."""
    return extension(node, VISIBILITY).get("visible", True) is False


def extension(entry: Entry, name: str) -> Entry:
    """Values of an entry's extension, empty if it is missing."""
    found = (entry.get("extensions") or {}).get(name)
    return found if isinstance(found, dict) else {}


def copies(node: Entry, accessors: Accessors) -> list[Array]:
    """The transform node_from_copy of each copy of a node's mesh, shape (4, 4) each; only the identity without
    instancing."""
    attributes = extension(node, INSTANCING).get("attributes", {})
    read = {key: accessors.read(int(attributes[key])).astype(np.float64) for key in
            ("TRANSLATION", "ROTATION", "SCALE") if key in attributes}  # fmt: skip
    if not read:
        return [np.eye(4)]
    keys = {"TRANSLATION": "translation", "ROTATION": "rotation", "SCALE": "scale"}
    counts = {len(values) for values in read.values()}
    if len(counts) > 1:
        raise ValueError(f"its instances have {sorted(counts)} values; all attributes must have as many")
    return [local_matrix({keys[key]: values[i] for key, values in read.items()}) for i in range(counts.pop())]


def morphed(position: Array, primitive: Entry, mesh: Entry, node: Entry, accessors: Accessors) -> Array:
    """The vertices of a primitive (n, 3) moved by its morph targets with the weights of its node or mesh."""
    targets = primitive.get("targets", [])
    weights = node.get("weights") or mesh.get("weights") or []
    for target, weight in zip(targets, weights, strict=False):
        if weight and "POSITION" in target:
            position = position + float(weight) * accessors.read(int(target["POSITION"])).astype(np.float64)
    return position


class Skins:
    """The skins of a document, posed by its nodes."""

    def __init__(self, path: Path, document: Json, accessors: Accessors) -> None:
        self.path, self.accessors = path, accessors
        self.nodes, self.skins = (entries(path, document, key) for key in ("nodes", "skins"))

    @cached_property
    def parents(self) -> dict[int, int]:
        """Index of the parent of each node that has one."""
        return {int(child): index for index, node in enumerate(self.nodes) for child in node.get("children", [])}

    def world_from_node(self, index: int) -> Array:
        """The global transform of a node, shape (4, 4)."""
        matrix = local_matrix(self.nodes[index])
        for _ in range(DEEPEST_NODE):
            if index not in self.parents:
                return matrix
            index = self.parents[index]
            matrix = local_matrix(self.nodes[index]) @ matrix
        raise FormatError(f"{self.path}: node {index} is its own ancestor, or lies more than {DEEPEST_NODE} nodes deep")

    def world_positions(self, skin: int, position: Array, attributes: dict[str, int]) -> Array:
        """Vertices (n, 3) moved with their joints, in the world: the node of the skin does not move them."""
        entry = self.skins[skin]
        joints = [self.world_from_node(int(one)) for one in entry["joints"]]
        if "inverseBindMatrices" in entry:
            bind = self.accessors.read(int(entry["inverseBindMatrices"])).astype(np.float64)
            joints = [joint @ one.reshape(4, 4).T for joint, one in zip(joints, bind, strict=False)]
        moved, total = np.zeros_like(position), np.zeros(len(position))
        for number in range(len(attributes)):
            if f"JOINTS_{number}" not in attributes:
                break
            which = self.accessors.read(attributes[f"JOINTS_{number}"]).astype(np.int64)
            weight = self.accessors.read(attributes[f"WEIGHTS_{number}"]).astype(np.float64)
            for corner in range(which.shape[1]):
                matrix = np.stack(joints)[which[:, corner]]
                at = np.einsum("nij,nj->ni", matrix[:, :3, :3], position) + matrix[:, :3, 3]
                moved += weight[:, corner, None] * at
                total += weight[:, corner]
        if not (total > 0.0).all():
            raise ValueError(f"{int((total <= 0.0).sum())} vertices of skin {skin} hang on no joint")
        return np.asarray(moved / total[:, None])


def read_gltf(path: Path, *, all_maps: bool = False) -> RawMesh:
    """Read the default scene of a glTF file.

    `all_maps`: also read transparency, factors, further maps and names of materials, in addition to base colours.
    """
    data = read_bytes(path)
    document, end = read_document(path, data)
    notes = _unread_extensions(path, document)
    accessors = Accessors(path, document, _buffers(path, document, binary_chunk(path, data, end)))
    return _GltfBuilder(path, document, accessors, notes, all_maps=all_maps).build()


def _unread_extensions(path: Path, document: Json) -> list[str]:
    """Refuse compression, with its remedy, and unknown required extensions; add a note for each other unknown
    extension."""
    used = {str(e) for key in ("extensionsUsed", "extensionsRequired") for e in require(path, document, key, list, [])}
    used |= _at_work(path, document)
    for name, remedy in COMPRESSED.items():
        if name in used:
            raise FormatError(f"{path}: compressed with {name}, which is not read; decode it first: {remedy}")
    unknown = sorted(str(e) for e in require(path, document, "extensionsRequired", list, []) if e not in UNDERSTOOD)
    if unknown:
        raise FormatError(f"{path}: requires the extension {', '.join(unknown)}, which is not read")
    return [f"{path.name} uses the glTF extension {one}, which is not read" for one in sorted(used - UNDERSTOOD)]


def _at_work(path: Path, document: Json) -> set[str]:
    """Extensions of primitives and buffer views, which some writers forget to declare."""
    primitives = [p for mesh in entries(path, document, "meshes") for p in mesh.get("primitives") or ()]
    found = [one.get("extensions") for one in (*primitives, *entries(path, document, "bufferViews"))]
    return {str(name) for one in found if isinstance(one, dict) for name in one}


def _buffers(path: Path, document: Json, binary: bytes | None) -> list[bytes]:
    """All buffers, each at least as long as stated."""
    buffers = []
    for index, entry in enumerate(entries(path, document, "buffers")):
        uri = require(path, entry, "uri", str, "")
        data = uri_bytes(path, uri) if uri else binary
        length = require(path, entry, "byteLength", int, 0)
        if data is None or len(data) < length:
            found = 0 if data is None else len(data)
            raise FormatError(
                f"{path}: buffer {index} promises {length} bytes, {found} are there: the file is truncated"
            )
        buffers.append(data)
    return buffers


class _GltfBuilder:
    """Collects the primitives of the node tree into one mesh."""

    def __init__(self, path: Path, document: Json, accessors: Accessors, notes: list[str], *, all_maps: bool) -> None:
        self.path, self.document, self.accessors = path, document, accessors
        self.nodes, self.meshes = (entries(path, document, key) for key in ("nodes", "meshes"))
        self.visited: set[int] = set()
        self.notes = notes
        self.names: list[str] = []
        self.labels: list[str | None] = []
        self.taken: dict[tuple[str, ...], int] = {}
        self.skins = Skins(path, document, accessors)
        self.looks = GltfMaterials(path, document, accessors, self.notes, all_maps=all_maps)
        self.vertices: list[NDArray[np.float64]] = []
        self.colors: list[NDArray[np.uint8] | None] = []
        self.faces: list[NDArray[np.int64]] = []
        self.face_node: list[NDArray[np.int32]] = []
        self.face_color: list[NDArray[np.uint8]] = []
        self.face_texture: list[NDArray[np.int32]] = []
        self.face_material: list[NDArray[np.int32]] = []
        self.uv_sets: list[list[NDArray[np.float64]]] = []
        self.vertex_count = 0
        self.face_count = 0

    def build(self) -> RawMesh:
        """Walk the default scene and join its meshes."""
        for root in self._roots():
            self._visit(root, np.eye(4), (), None, 0)
        if not self.faces:
            raise InputError(f"{self.path}: the scene has no triangles; a surface is needed")
        painted = bool(self.looks.textures) or len(self.looks.materials) > 1
        painted = painted or any((c != 200).any() for c in self.face_color)
        colored = any(c is not None for c in self.colors)
        white = [
            np.full((len(v), 3), 255, np.uint8) if c is None else c
            for v, c in zip(self.vertices, self.colors, strict=True)
        ]
        return RawMesh(
            path=self.path, vertices=np.concatenate(self.vertices), faces=np.concatenate(self.faces),
            colors=np.concatenate(white) if colored else None, paint=self._paint() if painted or not colored else None,
            face_node=np.concatenate(self.face_node), node_names=tuple(self.names), up="y", unit_metres=1.0,
            notes=tuple(dict.fromkeys(self.notes)),
            node_labels=tuple(self.labels) if any(label is not None for label in self.labels) else (),
        )  # fmt: skip

    def _paint(self) -> Paint:
        uv, *more = (
            np.concatenate([
                np.zeros((len(faces), 3, 2)) if own is None else own
                for own, faces in zip(sets, self.faces, strict=True)
            ])
            for sets in zip_longest(*self.uv_sets)
        )  # fmt: skip
        return Paint(
            np.concatenate(self.face_color), np.concatenate(self.face_texture), uv, tuple(self.looks.textures),
            tuple(self.looks.wraps), np.concatenate(self.face_material), tuple(self.looks.materials), tuple(more),
        )  # fmt: skip

    def _roots(self) -> list[int]:
        """Root nodes of the default scene; without scenes, all nodes that are nobody's child."""
        scenes = entries(self.path, self.document, "scenes")
        if scenes:
            scene = require(self.path, self.document, "scene", int, 0)
            if not 0 <= scene < len(scenes):
                raise FormatError(f"{self.path}: glTF key 'scene' is {scene}, the file has {len(scenes)} scenes")
            return [int(i) for i in scenes[scene].get("nodes", [])]
        children = {child for node in self.nodes for child in node.get("children", [])}
        return [i for i in range(len(self.nodes)) if i not in children]

    def _visit(
        self, index: int, world_from_parent: NDArray[np.float64], trail: tuple[str, ...], label: str | None, depth: int
    ) -> None:
        """Collect a node and its descendants; `label` is the annotated label of its instance, at which trails begin."""
        if index in self.visited:
            raise FormatError(f"{self.path}: node {index} has two parents, or is its own ancestor")
        if depth == DEEPEST_NODE:
            raise FormatError(f"{self.path}: node {index} lies more than {DEEPEST_NODE} nodes deep; flatten the tree")
        self.visited.add(index)
        if is_hidden(self.nodes[index]):
            self.notes.append("nodes that the file hides are left out")
            return
        try:
            world_from_node, trail, label = self._take(index, world_from_parent, trail, label)
            children = [int(child) for child in self.nodes[index].get("children", [])]
        except INCONSISTENT as broken:
            raise FormatError(
                f"{self.path}: node {index} is inconsistent ({type(broken).__name__}: {broken})"
            ) from None
        for child in children:
            self._visit(child, world_from_node, trail, label, depth + 1)

    def _take(
        self, index: int, world_from_parent: NDArray[np.float64], trail: tuple[str, ...], label: str | None
    ) -> tuple[NDArray[np.float64], tuple[str, ...], str | None]:
        """Collect the meshes that one node draws; returns its own frame, trail and label."""
        node = self.nodes[index]
        world_from_node = world_from_parent @ local_matrix(node)
        mesh = self.meshes[require(self.path, node, "mesh", int, 0)] if "mesh" in node else None
        own = _annotated_label(node)
        if own is not None:
            trail, label = (), own
        own_trail = (*trail, _name(node, mesh, index))
        trail = self._unique(own_trail)
        if mesh is not None:
            for number, node_from_copy in enumerate(copies(node, self.accessors)):
                self.names.append("/".join(self._unique(own_trail) if number else trail))
                self.labels.append(label)
                for primitive in mesh["primitives"]:
                    self._add(primitive, mesh, node, world_from_node @ node_from_copy)
        return world_from_node, trail, label

    def _unique(self, trail: tuple[str, ...]) -> tuple[str, ...]:
        """The trail with a number after its last name if an earlier node has the same trail: they are different
        things."""
        free = trail
        while free in self.taken:
            self.taken[trail] += 1
            free = (*trail[:-1], f"{trail[-1]}.{self.taken[trail]}")
        self.taken[free] = 1
        return free

    def _add(self, primitive: Entry, mesh: Entry, node: Entry, world_from_node: NDArray[np.float64]) -> None:
        """Append one primitive of a node's mesh; points and lines are left out."""
        mode = int(primitive.get("mode", 4))
        if mode not in (4, 5, 6):
            self.notes.append("points and lines are ignored")
            return
        attributes: dict[str, int] = primitive["attributes"]
        position = self.accessors.read(attributes["POSITION"]).astype(np.float64)
        position = morphed(position, primitive, mesh, node, self.accessors)
        index = np.arange(len(position))
        if "indices" in primitive:
            index = self.accessors.read(int(primitive["indices"])).reshape(-1).astype(np.int64)
        faces = _triangles(index, mode)
        wrong = (faces < 0) | (faces >= len(position))
        if wrong.any():
            what = f"a face uses vertex {faces[wrong][0]}, its primitive has {len(position)} ({self.names[-1]})"
            raise format_error(self.path, what, ("accessors", int(primitive.get("indices", attributes["POSITION"]))))
        self.face_count += len(faces)
        check_face_count(self.path, self.face_count)
        check_vertex_count(self.path, self.vertex_count + len(position))
        if "skin" in node and "JOINTS_0" in attributes:
            self.vertices.append(self.skins.world_positions(int(node["skin"]), position, attributes))
        else:
            self.vertices.append(position @ world_from_node[:3, :3].T + world_from_node[:3, 3])
            if np.linalg.det(world_from_node[:3, :3]) < 0:
                faces = faces[:, ::-1]
        self.faces.append(faces + self.vertex_count)
        self.vertex_count += len(position)
        self.colors.append(self._vertex_colors(attributes, len(position)))
        self.face_node.append(np.full(len(faces), len(self.names) - 1, dtype=np.int32))
        self._add_paint(primitive, attributes, faces)

    def _vertex_colors(self, attributes: dict[str, int], count: int) -> NDArray[np.uint8] | None:
        """COLOR_0 as bytes. The standard says linear, but most tools that write it mean sRGB, and so do we."""
        if "COLOR_0" not in attributes:
            return None
        values = self.accessors.read(attributes["COLOR_0"])[:, :3]
        levels = values.astype(np.float64) * (1.0 if values.dtype == np.uint8 else 255.0)
        return np.clip(np.rint(levels), 0, 255).astype(np.uint8) if levels.shape == (count, 3) else None

    def _add_paint(self, primitive: Entry, attributes: dict[str, int], faces: NDArray[np.int64]) -> None:
        """Base colour, texture and material of one primitive."""
        look = self.looks.look(primitive, attributes)
        self.face_color.append(np.tile(np.array(look.color, dtype=np.uint8), (len(faces), 1)))
        self.face_texture.append(np.full(len(faces), look.slot, dtype=np.int32))
        self.face_material.append(np.full(len(faces), look.material, dtype=np.int32))
        uv_sets = [uv[faces] for uv in look.uv_sets.values()]
        self.uv_sets.append(uv_sets or [np.zeros((len(faces), 3, 2))])


def _name(node: Entry, mesh: Entry | None, index: int) -> str:
    """The node's name, else its mesh's; '/' is reserved for trails."""
    return short_name(str(node.get("name") or (mesh or {}).get("name") or f"node_{index}")).replace("/", "_")


def _annotated_label(node: Entry) -> str | None:
    """Annotated label of a node: `label` of its extras, as written by `dcap.scene.writers.glb`."""
    extras = node.get("extras")
    label = extras.get("label") if isinstance(extras, dict) else None
    return " ".join(label.lower().split()) if isinstance(label, str) else None


def _triangles(index: NDArray[np.int64], mode: int) -> NDArray[np.int64]:
    """Vertex triples of triangles (4), a strip (5) or a fan (6)."""
    if mode == 4:
        return index[: len(index) // 3 * 3].reshape(-1, 3)
    if len(index) < 3:
        return np.zeros((0, 3), dtype=np.int64)
    if mode == 6:
        return np.stack([np.full(len(index) - 2, index[0]), index[1:-1], index[2:]], axis=1)
    strip = np.stack([index[:-2], index[1:-1], index[2:]], axis=1)
    strip[1::2] = strip[1::2, [1, 0, 2]]
    return strip
