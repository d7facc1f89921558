"""Covers of a base: which of its parts are spread over others, how thick each is, and what each lies on.

A scan shows the top of a blanket and nothing beneath. In: a base as it was scanned, soft and rigid parts. Out: for
every cover its thickness, measured where its edge is seen beside what it lies on, and the covers beneath it.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from dcap.geometry.boundary import is_closed
from dcap.geometry.pieces import signed_volume
from dcap.geometry.solid.repair import subdivide_near
from dcap.geometry.solid.support import COVERED, TOUCHING, over, plan_samples
from dcap.language.covers import cover_thickness
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.segmentation import Instance

Array = NDArray[np.float64]

UPWARD = 0.8  # of a normal's z: faces that show how high a layer lies [-]
NEAR_EDGE = 0.06  # a cover's top and the top of what it lies on are compared this far apart in plan [m]
PATCH = 0.5 * NEAR_EDGE  # longest edge of the faces that are compared [m]
LEAST_PAIRS = 8  # of places along the edge
SPREAD = 0.5  # middle half of the steps over their median: where they scatter more, the edge shows no thickness [-]
THINNEST, THICKEST = 0.002, 0.12  # steps outside are no edge of a cover [m]


@dataclass(frozen=True, slots=True)
class Step:
    """How far a cover's top lies above another part beside it."""

    height: float
    """[m]."""
    pairs: int
    """Places along the edge that show it [-]."""


@dataclass(frozen=True, slots=True)
class Cover:
    """One part that lies over others."""

    part: int
    thickness: float
    """[m]."""
    why: str
    """How the thickness is known."""
    beside: int | None = None
    """The part whose top is seen beside its edge, a layer's thickness lower; None where none is."""

    @property
    def measured(self) -> bool:
        """Whether its edge shows the thickness; else it is what such covers usually have."""
        return self.why in (SHOWN, CLOSED)


SHOWN, CLOSED, UNEVEN, UNSEEN = (
    "as its edge shows",
    "as its closed surface shows",
    "as is usual: no even step is seen along its edge",
    "as is usual: nothing is seen beside it that it lies on",
)


def covers_of(
    base: Instance, soft: Sequence[int], mesh: Mesh, part: NDArray[np.int32], around: Sequence[Mesh] = ()
) -> dict[int, Cover]:
    """The covers among the soft parts of a base, by part; `part` (m,) is that of each face of `mesh`, all of the base.

    What a thing lies on that is a cover as a whole is another thing, one of those `around` it.
    """
    found = {}
    for index in soft:
        usual = cover_thickness(base.parts[index].name)
        if usual is None and len(base.parts) == 1:
            usual = cover_thickness(base.label)  # a rug is one part, whatever that is called
        if usual is not None and (part == index).any():
            others = {other: mesh.submesh(np.flatnonzero(part == other)) for other in set(part.tolist()) - {index}}
            if len(base.parts) == 1:
                others = {-1 - number: one for number, one in enumerate(around)}
            found[index] = measured_cover(index, usual, mesh.submesh(np.flatnonzero(part == index)), others)
    return found


def measured_cover(index: int, usual: float, mesh: Mesh, others: Mapping[int, Mesh]) -> Cover:
    """A cover by what its edge shows beside others, else `usual` [m] thick."""
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
    """Volume over area in plan of a surface that is closed [m]; None of any other, and of what is no layer."""
    if not is_closed(mesh):
        return None
    normal = mesh.face_normals[:, 2]
    plan = 0.5 * float(normal[normal > 0.0].sum())
    thickness = abs(signed_volume(mesh.vertices, mesh.faces)) / max(plan, np.finfo(float).tiny)
    return thickness if THINNEST < thickness < THICKEST else None


def steps_beside(above: Array, beneath: Array) -> Array:
    """How far each place (n, 3) lies below the nearest one above it in plan, of those near enough [m]."""
    if not len(above) or not len(beneath):
        return np.zeros(0)
    distance, nearest = cKDTree(above[:, :2]).query(beneath[:, :2], distance_upper_bound=NEAR_EDGE)
    beside = np.isfinite(distance)
    return np.asarray(above[nearest[beside], 2] - beneath[beside, 2])


def even_step(heights: Array) -> Step | None:
    """The step that most of the heights [m] along an edge show; None where they show none."""
    step = heights[(heights > THINNEST) & (heights < THICKEST)]
    if len(step) < LEAST_PAIRS or len(step) < 0.5 * len(heights):
        return None
    low, median, high = np.quantile(step, [0.25, 0.5, 0.75])
    return Step(float(median), len(step)) if high - low < SPREAD * median else None


def upward_places(mesh: Mesh, region: Array) -> Array:
    """Middles of the faces that look up, large ones in pieces where they reach into a box (2, 3) [m], shape (n, 3)."""
    chosen = mesh.submesh(np.flatnonzero(looks_up(mesh)))
    return subdivide_near(chosen, region, PATCH).triangles.mean(axis=1) if len(chosen.faces) else np.zeros((0, 3))


def looks_up(mesh: Mesh) -> NDArray[np.bool_]:
    """Faces that look up, shape (m,)."""
    normal = mesh.face_normals
    return np.asarray(normal[:, 2] > UPWARD * np.linalg.norm(normal, axis=1))


def lies_under(base: Instance, lower: int, cover: Cover) -> bool:
    """Whether a part is seen beside a cover's edge, that much lower, or begins below it with a good share of one over
    the other: a blanket may hang lower than the mattress that carries it or hide all of it but the head end, and a
    throw lie on a part of a sofa."""
    low, high = base.parts[lower].box, base.parts[cover.part].box
    begins_below = low.bottom < high.top - cover.thickness - TOUCHING
    return lower == cover.beside or (begins_below and overlap(base, lower, cover.part))


def overlap(base: Instance, one: int, other: int) -> bool:
    """Whether a good share of one of two parts lies over or under the other."""
    a, b = base.parts[one].box, base.parts[other].box
    return max(over(plan_samples(b), a), over(plan_samples(a), b)) > COVERED


def covers_beneath(
    base: Instance, covers: Mapping[int, Cover], mesh: Mesh, part: NDArray[np.int32]
) -> dict[int, list[int]]:
    """The covers under each cover, from the top down: those that overlap it and lie lower where both are seen."""
    order = sorted(covers, key=lambda index: (-top_of(mesh, part == index), plan_area(base, index), index))
    return {
        upper: [lower for lower in order[place + 1 :] if overlap(base, lower, upper)]
        for place, upper in enumerate(order)
    }


def plan_area(base: Instance, index: int) -> float:
    """Of a part's box [m^2]: of two covers at one height the smaller lies on the larger."""
    return float(4.0 * np.prod(base.parts[index].box.half_extents[:2]))


def top_of(mesh: Mesh, faces: NDArray[np.bool_]) -> float:
    """Median height of the faces (m,) that look up [m], of all of them where none does."""
    upward = faces & looks_up(mesh)
    return float(np.median(mesh.triangles[upward if upward.any() else faces][:, :, 2]))
