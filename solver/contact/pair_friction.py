"""Friction and rolling resistance where two surfaces touch: of each the part that is there, together their geometric
means."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from solver.contact.nearest_face import NearestFace
from solver.model.bodies import Body, Model

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False, slots=True)
class PairFriction:
    """Coefficients of the points of one body against another."""

    own: Array
    """Static and dynamic friction [-] and rolling resistance length [m] of each point, shape (n, 3)."""
    other: Array
    """The same of each kind of face of the other body, or one row for all, shape (m, 3) or (1, 3)."""
    faces: NearestFace | None
    """Its faces in the start pose, labelled with their kinds; None if one row stands for all."""
    given: tuple[float, float] | None = None
    """Static and dynamic friction that were set for this pair of bodies."""

    @classmethod
    def of(cls, model: Model, a: Body, b: Body) -> "PairFriction":
        """Of the points of `a` against `b`."""
        own = np.broadcast_to(a.friction_rows, (len(a.vertices), 3))
        if b.face_friction is None:
            return cls(own, b.friction_rows, None, model.given_friction(a, b))
        kinds, label = np.unique(b.face_friction, axis=0, return_inverse=True)
        found = NearestFace.of(b.vertices, b.faces, label.reshape(-1))
        return cls(own, kinds, found, model.given_friction(a, b))

    def at(self, index: NDArray[np.int64], material: Array) -> Array:
        """Of the pair at some points (k,) that touch the other body at material points (k, 3) of its start pose [m],
        shape (k, 3)."""
        row = np.zeros(len(index), dtype=np.int64) if self.faces is None else self.faces.label_at(material)
        both = np.sqrt(self.own[index] * self.other[row])
        if self.given is not None:
            both[:, :2] = self.given
        return np.asarray(both)
