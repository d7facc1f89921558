"""Layers of a soft base: which part lies at which depth, and which way the layers of cloth lie there.

In: the soft parts of a base as they are seen, and its covers. Out: for every point the part that it belongs to, within
a cover's thickness below its open surface that cover, deeper the covers beneath it, each as thick as it is, and below
them what carries them; and the normals of layers, across the open surface of the part.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dcap.geometry.distance import MeshDistance
from dcap.geometry.raycast import Raycaster
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.particles import ColumnLayer
from dcap.scene.types.segmentation import Instance
from tasks.particles.covers import Cover

Array = NDArray[np.float64]

COLUMN_STEPS = 400
OFF_FACE, WAY_OUT = 1e-3, 0.5  # a ray starts this far from its face, and is out after so far [m]
UPRIGHT = (0.0, 0.0, 1.0)
# Averages over a normal distribution: its middle and the twelve corners of an icosahedron, with weights. Averages over
# those corners are those over the sphere up to the fifth degree; E|x|^2 = 3 and E|x|^4 = 15 fix radius and weight:
# 12 w r^2 = 3, 12 w r^4 = 15. So the rule is exact to the fifth degree, with 13 points for the 27 of a product rule
GOLDEN = 0.5 * (1.0 + 5.0**0.5)
CORNERS = [
    np.roll([0.0, a, b * GOLDEN], turn) for turn in range(3) for a in (-1.0, 1.0) for b in (-1.0, 1.0)
]  # fmt: skip
NORMAL_RULE = [
    (np.zeros(3), 0.4),
    *((5.0**0.5 * corner / float(np.linalg.norm(corner)), 0.05) for corner in CORNERS),
]


@dataclass(frozen=True, eq=False, slots=True)
class BaseLayers:
    """The soft parts of a base in the crop, prepared to say what lies where."""

    base: Instance
    soft: tuple[int, ...]
    """Indices of all soft parts, also of those that are seen elsewhere only."""
    covers: Mapping[int, Cover]
    """Those of them that are covers."""
    beneath: Mapping[int, Sequence[int]]
    """The covers under each cover, from the top down."""
    mesh: Mesh
    """Their visible surfaces in the crop."""
    part: NDArray[np.int32]
    """Of each face, shape (m,)."""
    nearest: MeshDistance
    """To look up the nearest of all that is seen."""
    surfaces: Mapping[int, MeshDistance]
    """The same for each part that is seen: of what is open of it, of all of it where nothing is."""
    carriers_seen: tuple[MeshDistance, NDArray[np.int32]] | None
    """The same for the parts that are no covers, with the part of each face; None where none is seen."""

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
        """Prepare what looks up the nearest."""
        out = open_faces(mesh)
        surfaces = {index: surface_of(mesh, part == index, out) for index in set(part.tolist())}
        seen = np.flatnonzero(~np.isin(part, list(covers)))
        carriers = (MeshDistance(mesh.submesh(seen)), part[seen]) if len(seen) else None
        return cls(base, tuple(soft), covers, beneath, mesh, part, MeshDistance(mesh), surfaces, carriers)

    @property
    def carrying(self) -> list[int]:
        """The parts that are no covers."""
        return [index for index in self.soft if index not in self.covers]

    def owners(self, position: Array) -> NDArray[np.int64]:
        """Part that each point (n, 3) belongs to, shape (n,): that of the nearest face, but deeper in a cover than it
        is thick what lies beneath."""
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
        """Part that each point (n, 3) belongs to that is so far below the underside of a cover [m], shape (n,)."""
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
        """The part, none of the covers, whose box holds each point (n, 3), the largest where several do, else that of
        the nearest face, else of the nearest box: under a blanket lies the mattress, though a pillow's faces may be
        nearer or none of its own be seen near by, shape (n,)."""
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
        """Unit normals, of either sign, of layers at points (n, 3) of parts (n,), upright where a part is none of
        those with layers, shape (n, 3)."""
        normal = np.tile(UPRIGHT, (len(position), 1))
        for index in set(layered) & set(owner.tolist()):
            within = np.flatnonzero(owner == index)
            surface = self.surfaces.get(index, self.nearest)  # one that is hidden lies as what is seen above it does
            normal[within] = normals_of_surface(surface, position[within], 0.5 * self.thickness(index))
        return normal

    def thickness(self, index: int) -> float:
        """Of a cover, else of the part's box where that is thinnest [m]."""
        if index in self.covers:
            return self.covers[index].thickness
        return 2.0 * float(self.base.parts[index].box.half_extents.min())


def surface_of(mesh: Mesh, own: NDArray[np.bool_], out: NDArray[np.bool_]) -> MeshDistance:
    """Open ones of a part's own faces (m,), otherwise all of them."""
    return MeshDistance(mesh.submesh(np.flatnonzero(own & out if (own & out).any() else own)))


def normals_of_surface(surface: MeshDistance, position: Array, reach: float) -> Array:
    """Axes across layers that lie along a surface, at points (n, 3): the first principal direction of the normals'
    products n n^T, averaged around each point with a deviation of `reach` [m] (layer_normals.py), shape (n, 3).

    The normal at a place is that of the face nearest to it.
    """
    normal = surface.mesh.face_normals
    normal /= np.maximum(np.linalg.norm(normal, axis=1, keepdims=True), np.finfo(float).tiny)
    tensor = np.zeros((len(position), 3, 3))
    for offset, weight in NORMAL_RULE:
        near = normal[surface.nearest_face(position + reach * offset)]
        tensor += weight * near[:, :, None] * near[:, None, :]
    return np.asarray(np.linalg.eigh(tensor)[1][:, :, 2])


def over_box(base: Instance, index: int, position: Array) -> NDArray[np.bool_]:
    """Which points (n, 3) lie over or under a part's box, shape (n,)."""
    box = base.parts[index].box
    return np.asarray((np.abs(box.to_local(position))[:, :2] <= box.half_extents[:2]).all(axis=1))


def box_distance(base: Instance, index: int, position: Array) -> Array:
    """From a part's box to each point (n, 3) [m], shape (n,)."""
    box = base.parts[index].box
    return np.asarray(np.linalg.norm(np.maximum(np.abs(box.to_local(position)) - box.half_extents, 0.0), axis=1))


def open_faces(mesh: Mesh) -> NDArray[np.bool_]:
    """The faces from which one gets out upwards, to one side or the other, shape (m,): a cover is as thick as it is
    below such a face, while faces of its that lie in the thing, where a model joins its pieces, bound nothing."""
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
    """Layers from the parts (n,) at growing depths [m] (n,); `names` holds part and material of each part."""
    starts = np.flatnonzero(np.diff(part, prepend=-1))
    ends = np.append(starts[1:], len(part) - 1)
    return tuple(
        ColumnLayer(*names[int(part[a])], float(depth[a]), float(depth[b])) for a, b in zip(starts, ends, strict=True)
    )
