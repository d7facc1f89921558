"""`dcap drop --load-aware`: bodies of a case with an invisible deflection under the load become rigid.

In: a checked case. Out: the same case with `model: rigid` where the predicted deflection is below a bound, and one
sentence for each. Only bodies with `model: auto`; bodies requested as soft stay soft.
"""

from pathlib import Path

import numpy as np

from solver.contact.predict import deflection
from tasks.case.file import Case
from tasks.case.solid import CaseSolid


def load_aware(case: Case, folder: Path, invisible: float) -> tuple[Case, list[str]]:
    """Make bodies rigid that give less than `invisible` [m] under the weight of all free bodies together.

    Hertz's indentation by the smallest curvature there is, and bending as a bar clamped at one end, unless the body is
    clamped at its bottom: then a bar as high as it is. Without a free body or gravity there is no load to predict from
    and nothing is changed.
    """
    solids = [CaseSolid(body, folder) for body in case.bodies]
    weight = float(np.linalg.norm(case.gravity)) * sum(s.mass for s in solids if not s.fixed)
    if weight == 0.0:
        return case, []
    radius = min(s.curvature_radius() for s in solids)
    bodies, notes = [], []
    for solid in solids:
        m, body = solid.material, solid.body
        depth = deflection(weight, radius, sides_of(solid), m.youngs_modulus, m.poisson_ratio)
        if not solid.rigid and body.model == "auto" and depth < invisible:
            body = body.model_copy(update={"model": "rigid"})
            notes.append(
                f"{body.name} is treated as rigid: at E {m.youngs_modulus:.3g} Pa it would give {1e3 * depth:.2g} mm "
                f"under {weight:.3g} N, below {1e3 * invisible:.2g} mm (load-aware)"
            )
        bodies.append(body)
    return case.model_copy(update={"bodies": bodies}), notes


def sides_of(solid: CaseSolid) -> tuple[float, float, float]:
    """Length, width and thickness [m] of the bar that represents a body."""
    if solid.primitive is not None:
        extent = 2.0 * solid.primitive.half_extents
    else:
        assert solid.given is not None
        extent = np.ptp(solid.given.bounds, axis=0)
    x, y, z = (float(side) for side in extent)
    if solid.fixed and solid.body.clamp in ("bottom", "z_min", "sides_and_bottom"):
        return z, max(x, y), min(x, y)
    thickness, width, length = sorted((x, y, z))
    return length, width, thickness
