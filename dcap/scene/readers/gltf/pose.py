"""Where the vertices of a glTF node are: its transform, its copies, its morph targets and its skin.

Source: Khronos, "glTF 2.0 Specification", sections 3.5.2 (transforms), 3.7.2.2 (morph targets), 3.7.3 (skins);
EXT_mesh_gpu_instancing.
"""

from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from dcap.scene.errors import FormatError
from dcap.scene.readers.gltf.accessor import Accessors
from dcap.scene.readers.gltf.document import Entry, Json, entries

FloatArray = NDArray[np.float64]

INSTANCING = "EXT_mesh_gpu_instancing"
VISIBILITY = "KHR_node_visibility"
DEEPEST_NODE = 256
"""Levels of the node tree: far above any scene that people make, far below Python's limit of recursion."""


def local_matrix(node: Entry) -> FloatArray:
    """parent_from_node of a node, from its matrix or its translation, rotation and scale, shape (4, 4)."""
    if "matrix" in node:
        return np.array(node["matrix"], dtype=np.float64).reshape(4, 4).T
    rotation = Rotation.from_quat(np.array(node.get("rotation", [0, 0, 0, 1]), dtype=np.float64)).as_matrix()
    matrix = np.eye(4)
    matrix[:3, :3] = rotation * np.array(node.get("scale", [1, 1, 1]), dtype=np.float64)
    matrix[:3, 3] = np.array(node.get("translation", [0, 0, 0]), dtype=np.float64)
    return matrix


def is_hidden(node: Entry) -> bool:
    """Whether a node, and all below it, is not shown."""
    return extension(node, VISIBILITY).get("visible", True) is False


def extension(entry: Entry, name: str) -> Entry:
    """Values of an entry's extension, empty where it has none."""
    found = (entry.get("extensions") or {}).get(name)
    return found if isinstance(found, dict) else {}


def copies(node: Entry, accessors: Accessors) -> list[FloatArray]:
    """node_from_copy of each copy of a node's mesh, shape (4, 4) each; the identity alone without instancing."""
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


def morphed(position: FloatArray, primitive: Entry, mesh: Entry, node: Entry, accessors: Accessors) -> FloatArray:
    """The vertices of a primitive (n, 3) moved by its morph targets with the weights of its node or mesh."""
    targets = primitive.get("targets", [])
    weights = node.get("weights") or mesh.get("weights") or []
    for target, weight in zip(targets, weights, strict=False):
        if weight and "POSITION" in target:
            position = position + float(weight) * accessors.read(int(target["POSITION"])).astype(np.float64)
    return position


class Skins:
    """The skins of a document, posed as its nodes stand."""

    def __init__(self, path: Path, document: Json, accessors: Accessors) -> None:
        self.path, self.accessors = path, accessors
        self.nodes, self.skins = (entries(path, document, key) for key in ("nodes", "skins"))

    @cached_property
    def parents(self) -> dict[int, int]:
        """Index of the parent of each node that has one."""
        return {int(child): index for index, node in enumerate(self.nodes) for child in node.get("children", [])}

    def world_from_node(self, index: int) -> FloatArray:
        """The global transform of a node, shape (4, 4)."""
        matrix = local_matrix(self.nodes[index])
        for _ in range(DEEPEST_NODE):
            if index not in self.parents:
                return matrix
            index = self.parents[index]
            matrix = local_matrix(self.nodes[index]) @ matrix
        raise FormatError(f"{self.path}: node {index} is its own ancestor, or lies more than {DEEPEST_NODE} nodes deep")

    def world_positions(self, skin: int, position: FloatArray, attributes: dict[str, int]) -> FloatArray:
        """Vertices (n, 3) moved with their joints, in the world: the node that has the skin does not move them."""
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
