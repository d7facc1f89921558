"""Closed-form guesses that choose a resolution before anything is simulated.

[J85] K. L. Johnson, Contact Mechanics, Cambridge University Press, 1985.
"""

import numpy as np


def contact_radius(weight: float, radius: float, youngs_modulus: float, poisson_ratio: float) -> float:
    """Radius [m] of the contact of a rigid sphere on an elastic half-space, Hertz [J85, Eq. 4.22].

    weight [N], sphere radius [m], Young's modulus [Pa], Poisson ratio [-].
    a = (3 W R / (4 E*))^(1/3), E* = E / (1 - nu^2); never more than the radius itself.
    """
    effective = youngs_modulus / (1.0 - poisson_ratio**2)
    return float(min((0.75 * weight * radius / effective) ** (1.0 / 3.0), radius))


def contact_stiffness(weight: float, radius: float, youngs_modulus: float, poisson_ratio: float) -> float:
    """Tangent stiffness dW/d(depth) [N/m] of the same contact at equilibrium: 2 E* a [J85, Sec. 4.2]."""
    effective = youngs_modulus / (1.0 - poisson_ratio**2)
    return float(2.0 * effective * np.float64(contact_radius(weight, radius, youngs_modulus, poisson_ratio)))
