"""Instances and parts of a mesh whose nodes are annotated: a ScanNet scene, a GLB that we wrote.

An annotated node is called `instance id` or `instance id/part`; what it says is taken as it is.
"""

import re

import numpy as np
from numpy.typing import NDArray

from dcap.geometry.segmentation.boxed import Group
from dcap.scene.types.scan import Scan

COUNTER = re.compile(r"\.\d+$")
"""Suffix that tells two nodes of one name apart."""


def annotated_groups(scan: Scan) -> tuple[list[Group], NDArray[np.int64]]:
    """The annotated instances in the order of their nodes, and the faces that no annotation speaks of."""
    trails = [name.split("/") for name in scan.node_names]
    labels = {trail[0]: label for trail, label in zip(trails, scan.node_labels, strict=True) if label}
    number = {one: index for index, one in enumerate(labels)}
    of_node = [number.get(trail[0], -1) if label else -1 for trail, label in zip(trails, scan.node_labels, strict=True)]
    instance = np.array([*of_node, -1], dtype=np.int64)[scan.face_node]
    silent = np.array([*(label is None for label in scan.node_labels), True])[scan.face_node]
    order = np.argsort(instance, kind="stable")
    ends = np.searchsorted(instance[order], np.arange(len(labels) + 1))
    groups = [
        Group(one, label, order[ends[i] : ends[i + 1]], None) for i, (one, label) in enumerate(labels.items())
    ]  # fmt: skip
    return [group for group in groups if len(group.faces)], np.flatnonzero(silent)


def annotated_parts(scan: Scan, faces: NDArray[np.int64]) -> tuple[NDArray[np.int64], list[str]] | None:
    """Part number of each face (k,) and the parts' names; None where the nodes of the faces name no parts."""
    if not scan.node_labels:
        return None
    nodes, number = np.unique(scan.face_node[faces], return_inverse=True)
    if nodes[0] < 0 or any(scan.node_labels[node] is None or "/" not in scan.node_names[node] for node in nodes):
        return None
    pieces = [scan.node_names[node].split("/")[1] for node in nodes]
    kinds = list(dict.fromkeys(pieces))
    part = np.array([kinds.index(piece) for piece in pieces], dtype=np.int64)[number.reshape(-1)]
    return part, [COUNTER.sub("", kind) for kind in kinds]
