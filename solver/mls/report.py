"""Mean forces on bodies over an interval of explicit steps."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from solver.certificate import PointForces
from solver.contact.active import TouchingPoints
from solver.contact.bonds import BondedPair

Array = NDArray[np.float64]


@dataclass(frozen=True, eq=False, slots=True)
class ContactReport:
    """Mean forces over an interval."""

    touching: list[TouchingPoints]
    bonded: list[tuple[BondedPair, Array, Array, Array]]
    """Bond, positions, mean forces on its first body, and stretches, shape (k, 3) each."""

    def pairs(self) -> set[tuple[int, int]]:
        """Bodies that hold each other, lower index first."""
        found = [one.pair.key for one in self.touching] + [(bond.a.body, bond.b.body) for bond, *_ in self.bonded]
        return {(min(key), max(key)) for key in found}

    def forces(self) -> PointForces:
        """Every force of a contact or bond, point by point."""
        some = [(*t.pair.key, t.position, t.force, False) for t in self.touching]
        some += [(bond.a.body, bond.b.body, position, force, True) for bond, position, force, _ in self.bonded]
        count = [len(one[3]) for one in some]
        a, b, bonded = (np.repeat(np.array([one[k] for one in some], dtype=kind), count)
                        for k, kind in ((0, np.int64), (1, np.int64), (4, np.bool_)))  # fmt: skip
        position, force = (np.concatenate([np.zeros((0, 3)), *(one[k] for one in some)]) for k in (2, 3))
        return PointForces(a, b, position, force, bonded)
