"""Forces of penetrating points: a normal spring, and a tangential one with a Coulomb return map [W06, Ch. 5].

[W06] Wriggers: Computational Contact Mechanics, 2nd ed., Springer 2006.
"""

import numpy as np
from numpy.typing import NDArray

from solver.model.state import PointMemory

# tangential over normal stiffness: Mindlin's ratio 2 (1 - nu) / (2 - nu) lies between 0.67 and 1; softer is safe
TANGENTIAL_SHARE = 0.5


def point_forces(
    friction: NDArray[np.float64],
    memory: PointMemory,
    index: NDArray[np.int64],
    gap: NDArray[np.float64],
    normal: NDArray[np.float64],
    slip: NDArray[np.float64],
) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64], NDArray[np.bool_]]:
    """Force on a (k, 3), its negative derivative at constant friction limits (k, 3, 3), new anchors (k, 3) and sliding
    flags (k,) of penetrating points; `friction` (k, 3) begins with their static and dynamic coefficients.

    A point that slid at the end of the last step feels mu_d, any other mu_s; the choice is fixed within a step,
    so that the force
    is a continuous function of the step's motion and Newton can converge.
    """
    stiffness = memory.stiffness[index]
    load = -stiffness * gap
    outer = normal[:, :, None] * normal[:, None, :]
    plane = np.eye(3) - outer
    trial = np.einsum("kij,kj->ki", plane, memory.anchor[index] + slip)
    size = np.linalg.norm(trial, axis=1)
    tangential = TANGENTIAL_SHARE * stiffness
    coefficient = np.where(memory.sliding[index], friction[:, 1], friction[:, 0])
    limit = coefficient * load
    slides = tangential * size > limit
    direction = np.divide(trial, size[:, None], out=np.zeros_like(trial), where=size[:, None] > 0.0)
    stretch = np.where(slides, limit / tangential, size)
    force = load[:, None] * normal - (tangential * stretch)[:, None] * direction
    ratio = np.where(slides, np.divide(stretch, size, out=np.ones_like(size), where=size > 0.0), 1.0)
    stuck = plane - np.where(slides, 1.0, 0.0)[:, None, None] * direction[:, :, None] * direction[:, None, :]
    tangent = stiffness[:, None, None] * outer + (tangential * ratio)[:, None, None] * stuck
    return force, tangent, stretch[:, None] * direction, slides
