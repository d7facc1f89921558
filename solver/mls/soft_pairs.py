"""The bounce of one soft body on another: a dashpot between their rigid motions, as for a rigid and a soft body.

Soft bodies meet in the grid's shared velocities, which conserve the energy of a bounce; kinetic damping takes strain
motion alone, so a soft ball on a soft slab would hop up and down for ever. At a node that both feel, the way from the
centroid of one's material to that of the other's is the contact's normal; the dashpot acts along the normals, weighted
by the reduced mass of what meets there, is implicit, changes no momentum of the pair, and vanishes at rest.
"""

from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from solver.config import SolverConfig
from solver.mls.bodies import SoftBodies
from solver.mls.coupling import dashpot_coefficient
from solver.model.bodies import Model
from solver.model.state import cross_matrix

Array = NDArray[np.float64]

# length of the mean of unit normals below which they have no common direction: that of a hemisphere's. Where they go
# farther around, normals lie opposite to each other, carry a load without any force in sum, and tell no direction
AROUND = 0.5


@dataclass(frozen=True, eq=False, slots=True)
class SoftContact:
    """Where and how two soft bodies meet."""

    center: Array
    """Mean place of the contact [m], shape (3,)."""
    normal: Array | None
    """Mean normal from the second to the first, of unit length, shape (3,); None where one body is around the other."""
    normal_matrix: Array
    """Mean of G^T n n^T G about the centre, G = [I, -[r]x], shape (6, 6)."""


class SoftPairs:
    """All pairs of soft bodies of which one moves."""

    def __init__(self, model: Model, soft: SoftBodies, config: SolverConfig) -> None:
        self.soft = soft
        index = soft.index
        self.dashpot = {
            (a, b): dashpot_coefficient(model, index[a], index[b], config)
            for a, b in combinations(range(len(index)), 2)
            if not (soft.is_fixed(a) and soft.is_fixed(b))
        }
        self.known: list[Array] = []
        self.touching: dict[tuple[int, int], SoftContact] = {}

    def damp(self, dt: float) -> None:
        """Let the dashpots of touching pairs act over dt [s]."""
        if self.known is not self.soft.shares:  # material has moved since
            self.known = self.soft.shares
            found = {pair: soft_contact(self.soft, *pair) for pair in self.dashpot}
            self.touching = {pair: contact for pair, contact in found.items() if contact is not None}
        for (a, b), contact in self.touching.items():
            self._damp(a, b, contact.center, self.dashpot[a, b] * dt * contact.normal_matrix)

    def _damp(self, a: int, b: int, center: Array, drag: Array) -> None:
        mobility = self.soft.inverse_mass(a, center) + self.soft.inverse_mass(b, center)
        before = self.soft.velocity(a, center) - self.soft.velocity(b, center)
        impulse = -drag @ np.linalg.solve(np.eye(6) + mobility @ drag, before)
        for part, sign in ((a, 1.0), (b, -1.0)):
            if not self.soft.is_fixed(part):
                change = sign * self.soft.inverse_mass(part, center) @ impulse
                change[:3] += np.cross(change[3:], self.soft.motion(part).center - center)
                self.soft.add_rigid_motion(part, change)


def soft_contact(soft: SoftBodies, a: int, b: int) -> SoftContact | None:
    """How two soft bodies, by their places in the list of soft ones, meet; None where no node feels both."""
    one, two = soft.shares[a], soft.shares[b]
    both = np.flatnonzero((one[:, 3] > soft.least_mass) & (two[:, 3] > soft.least_mass))
    way = one[both, :3] / one[both, 3:] - two[both, :3] / two[both, 3:]
    size = np.linalg.norm(way, axis=1)
    both, way, size = both[size > 0.0], way[size > 0.0], size[size > 0.0]
    if not len(both):
        return None
    normal = way / size[:, None]
    weight = one[both, 3] * two[both, 3] / (one[both, 3] + two[both, 3])
    weight /= weight.sum()
    at = soft.grid.low + soft.grid.cell * np.stack(np.unravel_index(both, tuple(soft.grid.shape)), axis=1)
    center = weight @ at
    Gn = np.concatenate([normal, np.einsum("kij,kj->ki", cross_matrix(at - center), normal)], axis=1)
    mean = weight @ normal
    length = float(np.linalg.norm(mean))
    common = mean / length if length > AROUND else None
    return SoftContact(center, common, np.einsum("k,ki,kj->ij", weight, Gn, Gn))
