"""Layers of a soft base: its covers, the part at each depth, and the orientation of cloth there.

In: the visible soft parts of a base, and its covers. Out: for every point the part that it belongs to: within a cover's
thickness below its open surface that cover, deeper the covers beneath it, each with its own thickness, and below them
the part that carries them; and the normals of layers, across the open surface of the part.

Covers of a base: the parts that are spread over other parts, their thickness, and the parts beneath them.

A scan shows the top of a blanket and nothing beneath. In: a scanned base with soft and rigid parts. Out: for every
cover its thickness, measured where its edge is visible next to its support, and the covers beneath it.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from dcap.arrays import Array
from dcap.geometry.distance import MeshDistance
from dcap.geometry.pieces import is_closed, signed_volume
from dcap.geometry.raycast import Raycaster
from dcap.geometry.solid.repair import subdivide_near
from dcap.geometry.solid.support import COVERED, TOUCHING, over, plan_samples
from dcap.knowledge.material_table import cover_thickness
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.particles import ColumnLayer
from dcap.scene.types.segmentation import Instance

UPWARD = 0.8  # of a normal's z: faces that show how high a layer lies [-]
NEAR_EDGE = 0.06  # distance in plan within which the top of a cover is compared with the top of its support [m]
PATCH = 0.5 * NEAR_EDGE  # longest edge of the faces that are compared [m]
LEAST_PAIRS = 8  # of places along the edge
SPREAD = 0.5  # middle half of the steps over their median: where they scatter more, the edge shows no thickness [-]
THINNEST, THICKEST = 0.002, 0.12  # a step outside this range is not the edge of a cover [m]
COLUMN_STEPS = 400
OFF_FACE, WAY_OUT = 1e-3, 0.5  # start of a ray from its face, and length after which it is outside [m]
UPRIGHT = (0.0, 0.0, 1.0)
# Averages over a normal distribution: its middle and the twelve corners of an icosahedron, with weights. Averages over
# those corners equal those over the sphere up to the fifth degree; E|x|^2 = 3 and E|x|^4 = 15 fix radius and weight: 12
# w r^2 = 3, 12 w r^4 = 15. So the rule is exact to the fifth degree, with 13 points for the 27 of a product rule
GOLDEN = 0.5 * (1.0 + 5.0**0.5)
CORNERS = [
    np.roll([0.0, a, b * GOLDEN], turn) for turn in range(3) for a in (-1.0, 1.0) for b in (-1.0, 1.0)
]  # fmt: skip
NORMAL_RULE = [
    (np.zeros(3), 0.4),
    *((5.0**0.5 * corner / float(np.linalg.norm(corner)), 0.05) for corner in CORNERS),
]


@dataclass(frozen=True, slots=True)
class Step:
    """Height of a cover's top above an adjacent part."""

    height: float
    """Height of the step [m]."""
    pairs: int
    """Number of pairs of places along the edge that show it [-]."""


@dataclass(frozen=True, slots=True)
class Cover:
    """A part that lies over other parts."""

    part: int
    thickness: float
    """Thickness of the cover [m]."""
    why: str
    """Origin of the thickness."""
    beside: int | None = None
    """The part whose top is visible next to the edge, lower by the thickness; None if there is none."""

    @property
    def measured(self) -> bool:
        """Whether the edge shows the thickness; otherwise it is the usual thickness of such covers."""
        return self.why in (SHOWN, CLOSED)


SHOWN, CLOSED, UNEVEN, UNSEEN = (
    "as its edge shows",
    "as its closed surface shows",
    "the usual thickness: no even step is visible along its edge",
    "the usual thickness: its support is not visible next to it",
)


def covers_of(
    base: Instance, soft: Sequence[int], mesh: Mesh, part: NDArray[np.int32], around: Sequence[Mesh] = ()
) -> dict[int, Cover]:
    """The covers among the soft parts of a base, by part; `part` (m,) is the part of each face of `mesh`, which
    contains only the base.

    If a whole thing is a cover, its support is another thing, one of those `around` it.
    """
    found = {}
    for index in soft:
        usual = cover_thickness(base.parts[index].name)
        if usual is None and len(base.parts) == 1:
            usual = cover_thickness(base.label)  # a rug is a single part, whatever its name
        if usual is not None and (part == index).any():
            others = {other: mesh.submesh(np.flatnonzero(part == other)) for other in set(part.tolist()) - {index}}
            if len(base.parts) == 1:
                others = {-1 - number: one for number, one in enumerate(around)}
            found[index] = measured_cover(index, usual, mesh.submesh(np.flatnonzero(part == index)), others)
    return found


def measured_cover(index: int, usual: float, mesh: Mesh, others: Mapping[int, Mesh]) -> Cover:
    """A cover with the thickness that its edge shows next to other parts, else `usual` [m]."""
    near = mesh.bounds + np.array([[-NEAR_EDGE], [NEAR_EDGE]])
    near[:, 2] = -np.inf, np.inf
    top = upward_places(mesh, near)
    solid = closed_thickness(mesh)
    beside = {other: steps_beside(top, upward_places(one, near)) for other, one in others.items()}
    steps = {other: step for other, heights in beside.items() if (step := even_step(heights)) is not None}
    best = max(steps, key=lambda other: (steps[other].pairs, -other), default=-1)
    if solid is not None:
        return Cover(index, solid, CLOSED, None if best < 0 else best)
    if not steps:
        seen = any(len(heights) >= LEAST_PAIRS for heights in beside.values())
        return Cover(index, usual, UNEVEN if seen else UNSEEN)
    return Cover(index, steps[best].height, SHOWN, None if best < 0 else best)


def closed_thickness(mesh: Mesh) -> float | None:
    """Volume over area in plan of a closed surface [m]; None for an open surface or one that is not a layer."""
    if not is_closed(mesh):
        return None
    normal = mesh.face_normals[:, 2]
    plan = 0.5 * float(normal[normal > 0.0].sum())
    thickness = abs(signed_volume(mesh.vertices, mesh.faces)) / max(plan, np.finfo(float).tiny)
    return thickness if THINNEST < thickness < THICKEST else None


def steps_beside(above: Array, beneath: Array) -> Array:
    """Depth of each place (n, 3) below the place above that is nearest in plan, for places that are near enough [m]."""
    if not len(above) or not len(beneath):
        return np.zeros(0)
    distance, nearest = cKDTree(above[:, :2]).query(beneath[:, :2], distance_upper_bound=NEAR_EDGE)
    beside = np.isfinite(distance)
    return np.asarray(above[nearest[beside], 2] - beneath[beside, 2])


def even_step(heights: Array) -> Step | None:
    """The step that most of the heights [m] along an edge show; None if they show none."""
    step = heights[(heights > THINNEST) & (heights < THICKEST)]
    if len(step) < LEAST_PAIRS or len(step) < 0.5 * len(heights):
        return None
    low, median, high = np.quantile(step, [0.25, 0.5, 0.75])
    return Step(float(median), len(step)) if high - low < SPREAD * median else None


def upward_places(mesh: Mesh, region: Array) -> Array:
    """Middles of upward faces, large faces in pieces where they reach into a box (2, 3) [m], shape (n, 3)."""
    chosen = mesh.submesh(np.flatnonzero(looks_up(mesh)))
    return subdivide_near(chosen, region, PATCH).triangles.mean(axis=1) if len(chosen.faces) else np.zeros((0, 3))


def looks_up(mesh: Mesh) -> NDArray[np.bool_]:
    """Mask of the faces that face up, shape (m,)."""
    normal = mesh.face_normals
    return np.asarray(normal[:, 2] > UPWARD * np.linalg.norm(normal, axis=1))


def lies_under(base: Instance, lower: int, cover: Cover) -> bool:
    """Return whether a part lies under a cover: it is visible next to the cover's edge, lower by its thickness, or
    begins below it and overlaps it well in plan. A blanket may hang lower than the mattress that carries it or hide all
    of it but the head end, and a throw may lie on a part of a sofa."""
    low, high = base.parts[lower].box, base.parts[cover.part].box
    begins_below = low.bottom < high.top - cover.thickness - TOUCHING
    return lower == cover.beside or (begins_below and overlap(base, lower, cover.part))


def overlap(base: Instance, one: int, other: int) -> bool:
    """Return whether one of two parts lies largely over or under the other."""
    a, b = base.parts[one].box, base.parts[other].box
    return max(over(plan_samples(b), a), over(plan_samples(a), b)) > COVERED


def covers_beneath(
    base: Instance, covers: Mapping[int, Cover], mesh: Mesh, part: NDArray[np.int32]
) -> dict[int, list[int]]:
    """The covers under each cover, from the top down: covers that overlap it and are lower where both are visible."""
    order = sorted(covers, key=lambda index: (-top_of(mesh, part == index), plan_area(base, index), index))
    return {
        upper: [lower for lower in order[place + 1 :] if overlap(base, lower, upper)]
        for place, upper in enumerate(order)
    }


def plan_area(base: Instance, index: int) -> float:
    """Area of a part's box in plan [m^2]: of two covers at one height the smaller lies on the larger."""
    return float(4.0 * np.prod(base.parts[index].box.half_extents[:2]))


def top_of(mesh: Mesh, faces: NDArray[np.bool_]) -> float:
    """Median height of the upward faces among (m,) [m], or of all of them if none faces up."""
    upward = faces & looks_up(mesh)
    return float(np.median(mesh.triangles[upward if upward.any() else faces][:, :, 2]))


@dataclass(frozen=True, eq=False, slots=True)
class BaseLayers:
    """The soft parts of a base in the crop, prepared for looking up the part at a point."""

    base: Instance
    soft: tuple[int, ...]
    """Indices of all soft parts, including those visible only elsewhere."""
    covers: Mapping[int, Cover]
    """The soft parts that are covers."""
    beneath: Mapping[int, Sequence[int]]
    """The covers under each cover, from the top down."""
    mesh: Mesh
    """Their visible surfaces in the crop."""
    part: NDArray[np.int32]
    """Part of each face, shape (m,)."""
    nearest: MeshDistance
    """Finds the nearest of all visible faces."""
    surfaces: Mapping[int, MeshDistance]
    """The same for each visible part: for its open faces, or for all of its faces if none is open."""
    carriers_seen: tuple[MeshDistance, NDArray[np.int32]] | None
    """The same for the parts that are not covers, with the part of each face; None if none is visible."""

    @classmethod
    def of(
        cls,
        base: Instance,
        soft: Sequence[int],
        covers: Mapping[int, Cover],
        beneath: Mapping[int, Sequence[int]],
        mesh: Mesh,
        part: NDArray[np.int32],
    ) -> "BaseLayers":
        """Prepare the search for nearest faces."""
        out = open_faces(mesh)
        surfaces = {index: surface_of(mesh, part == index, out) for index in set(part.tolist())}
        seen = np.flatnonzero(~np.isin(part, list(covers)))
        carriers = (MeshDistance(mesh.submesh(seen)), part[seen]) if len(seen) else None
        return cls(base, tuple(soft), covers, beneath, mesh, part, MeshDistance(mesh), surfaces, carriers)

    @property
    def carrying(self) -> list[int]:
        """The parts that are not covers."""
        return [index for index in self.soft if index not in self.covers]

    def owners(self, position: Array) -> NDArray[np.int64]:
        """Part that each point (n, 3) belongs to, shape (n,): the part of the nearest face; deeper in a cover than its
        thickness, the part beneath."""
        if len(self.surfaces) == 1:
            nearest = np.full(len(position), self.part[0], dtype=np.int64)
        else:
            nearest = self.part[self.nearest.nearest_face(position)].astype(np.int64)
        owner = nearest.copy()
        for index, cover in self.covers.items():
            within = np.flatnonzero(nearest == index)
            if len(within):
                below = self.surfaces[index].unsigned(position[within]) - cover.thickness
                owner[within] = self.under(index, position[within], below)
        return owner

    def under(self, upper: int, position: Array, below: Array) -> NDArray[np.int64]:
        """Part that each point (n, 3) belongs to, for points at a depth `below` the underside of a cover [m], shape
        (n,)."""
        owner, left = np.full(len(position), upper, dtype=np.int64), below.copy()
        for lower in self.beneath[upper]:
            there = np.flatnonzero((left > 0.0) & over_box(self.base, lower, position))
            owner[there] = lower
            left[there] -= self.covers[lower].thickness
        deep = np.flatnonzero(left > 0.0)
        if len(deep) and self.carrying:
            owner[deep] = self.carriers(position[deep])
        return owner

    def carriers(self, position: Array) -> NDArray[np.int64]:
        """The part, not a cover, whose box contains each point (n, 3), the largest of several; else the part of the
        nearest face, else of the nearest box, shape (n,). Under a blanket lies the mattress, even if a pillow's faces
        are nearer or none of the mattress is visible nearby."""
        if self.carriers_seen is not None:
            field, part = self.carriers_seen
            owner = part[field.nearest_face(position)].astype(np.int64)
        else:
            away = [box_distance(self.base, index, position) for index in self.carrying]
            owner = np.array(self.carrying)[np.argmin(away, axis=0)]
        for index in sorted(self.carrying, key=lambda one: float(np.prod(self.base.parts[one].box.half_extents))):
            owner[self.base.parts[index].box.contains(position)] = index
        return owner

    def normals(self, position: Array, owner: NDArray[np.integer], layered: Sequence[int]) -> Array:
        """Unit normals, of either sign, of layers at points (n, 3) of parts (n,); vertical for parts without layers,
        shape (n, 3)."""
        normal = np.tile(UPRIGHT, (len(position), 1))
        for index in set(layered) & set(owner.tolist()):
            within = np.flatnonzero(owner == index)
            surface = self.surfaces.get(index, self.nearest)  # a hidden part follows the visible surface above it
            normal[within] = normals_of_surface(surface, position[within], 0.5 * self.thickness(index))
        return normal

    def thickness(self, index: int) -> float:
        """Thickness of a cover, or of another part along the thinnest side of its box [m]."""
        if index in self.covers:
            return self.covers[index].thickness
        return 2.0 * float(self.base.parts[index].box.half_extents.min())


def surface_of(mesh: Mesh, own: NDArray[np.bool_], out: NDArray[np.bool_]) -> MeshDistance:
    """The open faces among a part's own faces (m,), or all of them if none is open."""
    return MeshDistance(mesh.submesh(np.flatnonzero(own & out if (own & out).any() else own)))


def normals_of_surface(surface: MeshDistance, position: Array, reach: float) -> Array:
    """Axes across layers that follow a surface, at points (n, 3): the first principal direction of the normals'
    products n n^T, averaged around each point with a deviation of `reach` [m] (discretization.py), shape (n, 3).

    The normal at a place is that of the nearest face.
    """
    normal = surface.mesh.face_normals
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), np.finfo(float).tiny)
    tensor = np.zeros((len(position), 3, 3))
    for offset, weight in NORMAL_RULE:
        near = normal[surface.nearest_face(position + reach * offset)]
        tensor += weight * near[:, :, None] * near[:, None, :]
    return np.asarray(np.linalg.eigh(tensor)[1][:, :, 2])


def over_box(base: Instance, index: int, position: Array) -> NDArray[np.bool_]:
    """Mask of the points (n, 3) that lie over or under a part's box, shape (n,)."""
    box = base.parts[index].box
    return np.asarray((np.abs(box.to_local(position))[:, :2] <= box.half_extents[:2]).all(axis=1))


def box_distance(base: Instance, index: int, position: Array) -> Array:
    """Distance from a part's box to each point (n, 3) [m], shape (n,)."""
    box = base.parts[index].box
    return np.asarray(np.linalg.norm(np.maximum(np.abs(box.to_local(position)) - box.half_extents, 0.0), axis=1))


def open_faces(mesh: Mesh) -> NDArray[np.bool_]:
    """Mask of the faces from which an upward ray escapes, on either side, shape (m,): a cover extends by its thickness
    below such a face, while its faces inside the thing, where a model joins its pieces, bound nothing."""
    out = np.zeros(len(mesh.faces), dtype=bool)
    normal = mesh.face_normals
    aside = normal / np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), 1e-12) * [1.0, 1.0, 0.0]
    middle, caster = mesh.triangles.mean(axis=1), Raycaster(mesh)
    for side in (aside, -aside):
        direction = side + np.array(UPRIGHT)
        direction /= np.linalg.norm(direction, axis=1, keepdims=True)
        out |= ~caster.occluded(middle + OFF_FACE * direction, direction, WAY_OUT)
    return out


def column_of(part: NDArray[np.int64], depth: Array, names: list[tuple[str, str]]) -> tuple[ColumnLayer, ...]:
    """Layers from the parts (n,) at increasing depths [m] (n,); `names` holds part and material of each part."""
    starts = np.flatnonzero(np.diff(part, prepend=-1))
    ends = np.append(starts[1:], len(part) - 1)
    return tuple(
        ColumnLayer(*names[int(part[a])], float(depth[a]), float(depth[b])) for a, b in zip(starts, ends, strict=True)
    )
