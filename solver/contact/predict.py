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


def indentation(weight: float, radius: float, youngs_modulus: float, poisson_ratio: float) -> float:
    """Depth [m] to which a rigid sphere sinks into an elastic half-space, Hertz [J85, Eq. 4.23].

    Arguments as of contact_radius; d = (9 W^2 / (16 R E*^2))^(1/3). A flat underside of half width R sinks less,
    W / (2 E* R) [J85, Sec. 3.4].
    """
    effective = youngs_modulus / (1.0 - poisson_ratio**2)
    return float((9.0 * weight**2 / (16.0 * radius * effective**2)) ** (1.0 / 3.0))


def bending(weight: float, length: float, width: float, thickness: float, youngs_modulus: float) -> float:
    """Bound of how far a bar bends [m]: twice the tip deflection W l^3 / (3 E I) of a cantilever, I = b t^3 / 12.

    Weight [N] at its tip, sides [m], Young's modulus [Pa]. Twice, because a round bar bends 1.7 times as far.
    """
    return 8.0 * weight * length**3 / (youngs_modulus * width * thickness**3)


def deflection(
    weight: float, radius: float, sides: tuple[float, float, float], youngs_modulus: float, poisson_ratio: float
) -> float:
    """The larger of indentation and bending [m]; `sides` are the bar's length, width and thickness [m]."""
    return max(indentation(weight, radius, youngs_modulus, poisson_ratio), bending(weight, *sides, youngs_modulus))
