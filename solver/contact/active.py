"""Pairs of bodies that can touch, and the points of them that do at one state, with their forces and derivatives."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from solver.contact.flatness import FlatRegions
from solver.contact.pair_friction import PairFriction
from solver.contact.rolling import RollingTorque, Spin
from solver.model.bodies import Body
from solver.model.state import ContactMemory, PointMemory


@dataclass(frozen=True, eq=False, slots=True)
class Pair:
    """Points of body `a` against the field of body `b`."""

    a: int
    b: int
    friction: PairFriction
    stiffness: NDArray[np.float64]
    """Normal stiffness per point at the start [N/m], shape (n,)."""
    area: NDArray[np.float64]
    """Surface area that a point stands for [m^2], shape (n,)."""
    safe_depth: float = np.inf
    """Mean penetration in motion beyond which points might come out on the other side of what they push into [m]."""
    flat: FlatRegions | None = None
    """Of a rigid body before a soft one: points whose region the other's own points cover do not count."""

    @property
    def key(self) -> tuple[int, int]:
        """Of the pair in ContactMemory.points."""
        return self.a, self.b

    def fresh_memory(self) -> PointMemory:
        """Before any step."""
        count = len(self.area)
        nowhere = np.full((count, 3), np.nan)
        none = np.zeros(count, dtype=bool)
        return PointMemory(self.stiffness.copy(), np.zeros((count, 3)), none.copy(), nowhere, none.copy())


@dataclass(frozen=True, eq=False, slots=True)
class TouchingPoints:
    """The points of one pair that touch at one state, or over a while, with mean forces then."""

    pair: Pair
    point: NDArray[np.int64]
    """Indices of the touching points of body a, shape (k,)."""
    position: NDArray[np.float64]
    """[m], shape (k, 3)."""
    gap: NDArray[np.float64]
    """[m], negative: penetration, shape (k,)."""
    normal: NDArray[np.float64]
    """Out of b, shape (k, 3)."""
    force: NDArray[np.float64]
    """On a [N], shape (k, 3)."""
    friction: NDArray[np.float64]
    """Static and dynamic coefficient [-] and rolling resistance length [m], shape (k, 3)."""
    sliding: NDArray[np.bool_]

    @property
    def normal_force(self) -> NDArray[np.float64]:
        """Normal part [N], shape (k,)."""
        return np.asarray(np.einsum("ki,ki->k", self.force, self.normal))


@dataclass(frozen=True, eq=False, slots=True)
class ActiveContacts(TouchingPoints):
    """The active points of one pair at one state, with what the implicit step needs of them."""

    tangent: NDArray[np.float64]
    """-d force / d relative displacement [N/m] at constant friction limits: symmetric, shape (k, 3, 3)."""
    anchor: NDArray[np.float64]
    """New anchors, shape (k, 3)."""
    node: NDArray[np.int64]
    """Nodes that move the point minus nodes that move the place of b that it pushes, shape (k, 16)."""
    weight: NDArray[np.float64]
    """Signed shape values, zero for rigid sides, shape (k, 16)."""


@dataclass(frozen=True, eq=False, slots=True)
class PairPoints:
    """Points of body `a` that body `b` pushes or holds, touching or bonded, as they enter the linear maps."""

    a: int
    b: int
    position: NDArray[np.float64]
    """[m], shape (k, 3)."""
    force: NDArray[np.float64]
    """On a [N], shape (k, 3)."""
    tangent: NDArray[np.float64]
    """As in ActiveContacts, shape (k, 3, 3)."""
    node: NDArray[np.int64]
    """Nodes that move the points minus nodes that move the places of b that they push, shape (k, 16)."""
    weight: NDArray[np.float64]
    """Signed shape values, zero for rigid sides, shape (k, 16)."""

    @classmethod
    def of(cls, t: ActiveContacts) -> "PairPoints":
        """Of what touches."""
        return cls(t.pair.a, t.pair.b, t.position, t.force, t.tangent, t.node, t.weight)


@dataclass(frozen=True, eq=False, slots=True)
class Contacts:
    """All active points of all pairs, and the bonded points, as linear maps."""

    active: tuple[ActiveContacts, ...]
    gather: sparse.csr_matrix
    """Relative displacement per point from node displacements, shape (k, n)."""
    force: NDArray[np.float64]
    tangent: NDArray[np.float64]
    position: NDArray[np.float64]
    a: NDArray[np.int64]
    b: NDArray[np.int64]
    rolling: tuple[RollingTorque, ...]
    spins: Mapping[int, Spin]
    """Spins of the free soft bodies in contact, by model index."""
    unlocated: int
    """Points that are in a soft body's cells while no place in its start pose was found for them; no contact there."""
    memory: ContactMemory
    """Contact memory after a step that ends here: the anchors of touching points; other points forget theirs."""

    def carried_load(self, bodies: int) -> NDArray[np.float64]:
        """Load that each body carries from one side to another [N], shape (bodies,): half of the difference between
        the sum of the sizes of its contact forces and the size of their sum; 0 for a body that only stands or hits."""
        size, total = np.zeros(bodies), np.zeros((bodies, 3))
        for which, sign in ((self.a, 1.0), (self.b, -1.0)):
            size += np.bincount(which, np.linalg.norm(self.force, axis=1), bodies)
            for axis in range(3):
                total[:, axis] += sign * np.bincount(which, self.force[:, axis], bodies)
        return np.asarray(0.5 * (size - np.linalg.norm(total, axis=1)), dtype=np.float64)


def vertex_areas(body: Body) -> NDArray[np.float64]:
    """A third of the adjacent triangle areas per vertex [m^2], shape (n,)."""
    corner = body.vertices[body.faces]
    area = 0.5 * np.linalg.norm(np.cross(corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]), axis=1)
    weights = np.repeat(area / 3.0, 3)
    return np.bincount(body.faces.ravel(), weights=weights, minlength=len(body.vertices)).astype(np.float64)
