"""Friction and rolling resistance where two surfaces touch: of each the part that is there, together their geometric
means."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from solver.model.bodies import Body, Model

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False, slots=True)
class PairFriction:
    """Coefficients of the points of one body against another."""

    own: Array
    """Static and dynamic friction [-] and rolling resistance length [m] of each point, shape (n, 3)."""
    other: Array
    """The same for each surface vertex of the other body, or one row for all, shape (m, 3) or (1, 3)."""
    vertices: cKDTree | None
    """Those vertices in its start pose; None if one row stands for all."""
    given: tuple[float, float] | None = None
    """Static and dynamic friction that were set for this pair of bodies."""

    @classmethod
    def of(cls, model: Model, a: Body, b: Body) -> "PairFriction":
        """Of the points of `a` against `b`."""
        uniform = b.point_friction is None
        return cls(
            own=np.broadcast_to(a.friction_rows, (len(a.vertices), 3)),
            other=b.friction_rows,
            vertices=None if uniform else cKDTree(b.vertices),
            given=model.given_friction(a, b),
        )

    def at(self, index: NDArray[np.int64], material: Array) -> Array:
        """Of the pair at some points (k,) that touch the other body at material points (k, 3) of its start pose [m],
        shape (k, 3)."""
        row = np.zeros(len(index), dtype=np.int64) if self.vertices is None else self.vertices.query(material)[1]
        both = np.sqrt(self.own[index] * self.other[row])
        if self.given is not None:
            both[:, :2] = self.given
        return np.asarray(both)
