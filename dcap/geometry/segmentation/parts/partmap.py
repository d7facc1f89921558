"""The answer of a part rule: a name per face and where the front is."""

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray


@dataclass(eq=False, slots=True)
class PartMap:
    """Names of the faces of one instance; a rule fills it and hands it back."""

    names: NDArray[np.object_]
    """Part name per face, shape (k,)."""
    confidence: float = 0.5
    """0..1, how well the rule's picture of the thing fits."""
    front: NDArray[np.float64] | None = None
    """Horizontal unit vector in the instance's frame, shape (3,)."""
    separate: frozenset[str] = field(default_factory=frozenset)
    """Names of which every connected patch is a part of its own."""

    @classmethod
    def filled(cls, count: int, name: str) -> "PartMap":
        """All faces under one name."""
        return cls(np.full(count, name, dtype=object))


SIDES = (np.array([1.0, 0, 0]), np.array([-1.0, 0, 0]), np.array([0, 1.0, 0]), np.array([0, -1.0, 0]))
"""Outward directions of the four sides of an instance's box."""
