"""Layers of a soft base: covers of their own thickness over what carries them.

A scan shows the top of a blanket and nothing beneath. In: the soft parts of a base as they are seen. Out: for every
cover its thickness, measured where its edge shows it, and for every point the part that it belongs to: within that
thickness below the cover's surface the cover, deeper what lies under it.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from dcap.geometry.distance import MeshDistance
from dcap.geometry.raycast import Raycaster
from dcap.geometry.solid.support import COVERED, TOUCHING, over, plan_samples
from dcap.language.covers import cover_thickness
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.particles import ColumnLayer
from dcap.scene.types.segmentation import Instance

Array = NDArray[np.float64]

UPWARD = 0.8  # of a normal's z: faces that show how high a layer lies [-]
NEAR_EDGE = 0.06  # a cover's top and the top of what it lies on are compared this far apart in plan [m]
LEAST_PAIRS = 8  # of places along the edge
SPREAD = 0.5  # middle half of the steps over their median: where they scatter more, the edge shows no thickness [-]
THINNEST, THICKEST = 0.002, 0.12  # steps outside are no edge of a cover [m]
COLUMN_STEPS = 400
OFF_FACE, WAY_OUT = 1e-3, 0.5  # a ray starts this far from its face, and is out after so far [m]


@dataclass(frozen=True, slots=True)
class Cover:
    """One part that lies over others."""

    part: int
    thickness: float
    """[m]."""
    measured: bool
    """Whether its edge shows the thickness; else it is what such covers usually have."""


def covers_of(base: Instance, soft: list[int], mesh: Mesh, part: NDArray[np.int32]) -> dict[int, Cover]:
    """The covers among the soft parts of a base, by part; `part` (m,) is that of each face of `mesh`."""
    found = {}
    for index in soft:
        usual = cover_thickness(base.parts[index].name)
        if usual is None and len(base.parts) == 1:
            usual = cover_thickness(base.label)  # a rug is one part, whatever that is called
        if usual is not None and (part == index).any():
            step = edge_step(mesh, part == index, part != index)
            found[index] = Cover(index, usual if step is None else step, step is not None)
    return found


def edge_step(mesh: Mesh, own: NDArray[np.bool_], others: NDArray[np.bool_]) -> float | None:
    """How far the top of some faces lies above that of others beside them [m]; None where no edge shows it."""
    upward, middle = looks_up(mesh), mesh.triangles.mean(axis=1)
    above, beneath = middle[own & upward], middle[others & upward]
    if not len(above) or not len(beneath):
        return None
    distance, nearest = cKDTree(above[:, :2]).query(beneath[:, :2], distance_upper_bound=NEAR_EDGE)
    beside = np.isfinite(distance)
    step = above[nearest[beside], 2] - beneath[beside, 2]
    step = step[(step > THINNEST) & (step < THICKEST)]
    if len(step) < LEAST_PAIRS or len(step) < 0.5 * beside.sum():
        return None
    low, median, high = np.quantile(step, [0.25, 0.5, 0.75])
    return float(median) if high - low < SPREAD * median else None


def looks_up(mesh: Mesh) -> NDArray[np.bool_]:
    """Faces that look up, shape (m,)."""
    normal = mesh.face_normals
    return np.asarray(normal[:, 2] > UPWARD * np.linalg.norm(normal, axis=1))


def top_of(mesh: Mesh, faces: NDArray[np.bool_]) -> float:
    """Median height of the faces (m,) that look up [m], of all of them where none does."""
    upward = faces & looks_up(mesh)
    return float(np.median(mesh.triangles[upward if upward.any() else faces][:, :, 2]))


def lies_under(base: Instance, lower: int, cover: Cover) -> bool:
    """Whether a part begins below a cover, with a good share of one over the other: a blanket may hang lower than the
    mattress that carries it, and a throw lie on a part of a sofa."""
    one, other = base.parts[lower].box, base.parts[cover.part].box
    beside = max(over(plan_samples(other), one), over(plan_samples(one), other))
    return beside > COVERED and one.bottom < other.top - cover.thickness - TOUCHING


def owners(
    base: Instance, covers: dict[int, Cover], mesh: Mesh, part: NDArray[np.int32], position: Array
) -> NDArray[np.int64]:
    """Part that each point (n, 3) belongs to: that of the nearest face, but deeper in a cover than it is thick what
    lies beneath, shape (n,)."""
    field = MeshDistance(mesh)
    owner = part[field.nearest_face(position)].astype(np.int64)
    beneath = np.flatnonzero(~np.isin(part, list(covers)))
    if not len(beneath) or not covers:
        return owner
    seen = open_faces(mesh, np.isin(part, list(covers)))
    for cover in covers.values():
        deep = np.flatnonzero(owner == cover.part)
        outside = np.flatnonzero(seen & (part == cover.part))
        if len(deep) and len(outside):
            deep = deep[MeshDistance(mesh.submesh(outside)).unsigned(position[deep]) > cover.thickness]
        if len(deep):
            owner[deep] = carriers(base, mesh.submesh(beneath), part[beneath], position[deep])
    return owner


def open_faces(mesh: Mesh, faces: NDArray[np.bool_]) -> NDArray[np.bool_]:
    """Those of the faces (m,) from which one gets out upwards, to one side or the other: a cover is as thick as it is
    below such a face, while faces of its that lie in the thing, where a model joins its pieces, bound nothing."""
    out, some = np.zeros(len(mesh.faces), dtype=bool), np.flatnonzero(faces)
    normal = mesh.face_normals[some]
    aside = normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12) * [1.0, 1.0, 0.0]
    middle, caster = mesh.corners(some).mean(axis=1), Raycaster(mesh)
    for side in (aside, -aside):
        direction = side + np.array([0.0, 0.0, 1.0])
        direction /= np.linalg.norm(direction, axis=1, keepdims=True)
        out[some] |= ~caster.occluded(middle + OFF_FACE * direction, direction, WAY_OUT)
    return out


def carriers(base: Instance, mesh: Mesh, part: NDArray[np.int32], position: Array) -> NDArray[np.int64]:
    """The part whose box holds each point (n, 3), the largest where several do, else that of the nearest face: under a
    blanket lies the mattress, though a pillow's faces may be nearer, shape (n,)."""
    owner = part[MeshDistance(mesh).nearest_face(position)].astype(np.int64)
    boxes = {int(one): base.parts[int(one)].box for one in np.unique(part)}
    for one, box in sorted(boxes.items(), key=lambda item: float(np.prod(item[1].half_extents))):
        owner[(np.abs(box.to_local(position)) <= box.half_extents).all(axis=1)] = one
    return owner


def column_of(part: NDArray[np.int64], depth: Array, names: list[tuple[str, str]]) -> tuple[ColumnLayer, ...]:
    """Layers from the parts (n,) at growing depths [m] (n,); `names` holds part and material of each part."""
    starts = np.flatnonzero(np.diff(part, prepend=-1))
    ends = np.append(starts[1:], len(part) - 1)
    return tuple(
        ColumnLayer(*names[int(part[a])], float(depth[a]), float(depth[b])) for a, b in zip(starts, ends, strict=True)
    )
