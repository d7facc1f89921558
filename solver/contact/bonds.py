"""Bonds: two bodies, soft or rigid, fixed or free, that stay together where they touch at the start.

Surface points of either body that start within REACH of the other are tied to its material point at the same place: a
spring of zero rest length in all three directions, implicit on both sides like a contact but without a limit. Its
stiffness keeps the stretch invisible (the penetration target) under a load of LOADS times the free weight; if one side
is soft, a spring far stiffer than its cells would only cost iterations.
"""

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from solver.certificate import BondRow
from solver.errors import ModelError
from solver.model.bodies import Body, Model, SignedDistance, SoftBody
from solver.model.soft import BodyGrid, SoftSystem, locate, shape_values
from solver.model.state import State

REACH = 2e-3  # surface points nearer to the other body than this [m] are bonded to it
LEAST_POINTS = 3  # fewer would act as a hinge
LOADS = 10.0  # a bond is designed for this multiple of the free bodies' weight: an impact of a few centimetres
STIFF = 100.0  # largest stiffness of a bonded point over E times the cell of a soft side [-]


@dataclass(frozen=True, eq=False, slots=True)
class BondedPoints:
    """Points that move with one body: with nodes of its field, or with its frame."""

    body: int
    rest: NDArray[np.float64]
    """Start positions [m], shape (k, 3)."""
    node: NDArray[np.int64]
    """Nodes of each point, shape (k, 8)."""
    weight: NDArray[np.float64]
    """Shape values of these nodes, zero for a rigid body, shape (k, 8)."""

    def position(self, model: Model, state: State) -> NDArray[np.float64]:
        """Current positions of the points [m], shape (k, 3)."""
        if self.weight.any():
            return np.asarray(np.einsum("ka,kai->ki", self.weight, state.x[self.node]))
        body = model.bodies[self.body]
        return np.asarray((self.rest - body.center_of_mass) @ state.rotation[self.body].T + state.center[self.body])


@dataclass(frozen=True, eq=False, slots=True)
class BondedPair:
    """The tied points of two bodies."""

    a: BondedPoints
    b: BondedPoints
    stiffness: NDArray[np.float64]
    """Stiffness per point [N/m], shape (k,)."""

    def stretch(self, model: Model, state: State) -> NDArray[np.float64]:
        """Vectors from the places on body b to those on body a [m], shape (k, 3)."""
        return self.a.position(model, state) - self.b.position(model, state)

    def force(self, model: Model, state: State) -> NDArray[np.float64]:
        """Forces on body a [N], shape (k, 3)."""
        return -self.stiffness[:, None] * self.stretch(model, state)


def build_bonds(model: Model, soft: SoftSystem, target: float) -> list[BondedPair]:
    """The bonds of a model; `target` is the target stretch [m]. Raises ModelError for bodies that do not touch."""
    names = [body.name for body in model.bodies]
    gravity = max(float(np.linalg.norm(model.gravity)), 1.0)
    free_weight = gravity * sum(body.mass for body in model.bodies if not body.fixed)
    soft_of = {s.index: s for s in soft.bodies}
    out = []
    for one, two in model.bonds:
        a, b = names.index(one), names.index(two)
        points = np.concatenate([_near(model.bodies[a], model.bodies[b]), _near(model.bodies[b], model.bodies[a])])
        attachments = [_attach(i, points, soft, soft_of.get(i)) for i in (a, b)]
        both = attachments[0][1] & attachments[1][1]
        if both.sum() < LEAST_POINTS:
            raise ModelError(
                f"bond {one!r}, {two!r}: {int(both.sum())} surface points lie within {1e3 * REACH:g} mm of the other "
                f"body at the start, need {LEAST_POINTS}; move the bodies together or refine their surfaces"
            )
        kept = [_only(attachment, both) for attachment, _ in attachments]
        stiffness = LOADS * free_weight / target / both.sum()
        for body in (model.bodies[a], model.bodies[b]):
            if isinstance(body, SoftBody):
                cell = min(float(np.diff(p).min()) for p in body.interior.planes)
                stiffness = min(stiffness, STIFF * float(body.interior.youngs_modulus.max()) * cell)
        out.append(BondedPair(kept[0], kept[1], np.full(int(both.sum()), stiffness)))
    return out


def _near(body: Body, other: Body) -> NDArray[np.float64]:
    """Surface points of a body that lie inside another body or within REACH of it."""
    return body.vertices[distance_at(other.distance, body.vertices) <= REACH]


def distance_at(grid: SignedDistance, points: NDArray[np.float64]) -> NDArray[np.float64]:
    """Trilinear signed distance [m] at points (n, 3), infinite outside the samples."""
    last = np.array(grid.values.shape) - 1
    at = (points - grid.origin) / grid.spacing
    inside = ((at >= 0.0) & (at <= last)).all(axis=1)
    low = np.clip(at.astype(np.int64), 0, last - 1)
    weight = shape_values(at - low)
    corner = low[:, None] + np.array(list(np.ndindex(2, 2, 2)))
    values = grid.values[corner[..., 0], corner[..., 1], corner[..., 2]]
    return np.where(inside, (weight * values).sum(axis=1), np.inf)


def _attach(
    index: int, points: NDArray[np.float64], soft: SoftSystem, one: BodyGrid | None
) -> tuple[BondedPoints, NDArray[np.bool_]]:
    """The attachment of points (k, 3) to a body, and the mask of those that lie in one of its cells."""
    node, weight = np.zeros((len(points), 8), dtype=np.int64), np.zeros((len(points), 8))
    if one is None:
        return BondedPoints(index, points, node, weight), np.ones(len(points), dtype=bool)
    inside = np.all([(points[:, a] >= p[0]) & (points[:, a] <= p[-1]) for a, p in enumerate(one.planes)], axis=0)
    flat, local = locate(one.planes, points[inside])
    cell = np.full(len(points), -1)
    cell[inside] = one.cell_id.ravel()[flat]
    weight[inside] = shape_values(local)
    node[cell >= 0] = soft.cell_node[cell[cell >= 0]]
    return BondedPoints(index, points, node, weight), cell >= 0


def _only(attachment: BondedPoints, keep: NDArray[np.bool_]) -> BondedPoints:
    return BondedPoints(attachment.body, attachment.rest[keep], attachment.node[keep], attachment.weight[keep])


def bond_table(
    model: Model, acting: Iterable[tuple[BondedPair, NDArray[np.float64], NDArray[np.float64]]]
) -> tuple[BondRow, ...]:
    """One row per bond for the certificate, from the forces on its first body and the stretches, shape (k, 3) each."""
    rows = []
    for bond, force, stretch in acting:
        a, b = model.bodies[bond.a.body].name, model.bodies[bond.b.body].name
        largest = float(np.linalg.norm(stretch, axis=1).max())
        rows.append(BondRow(a, b, len(force), float(np.linalg.norm(force.sum(axis=0))), largest))
    return tuple(rows)
