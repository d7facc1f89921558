"""Which bodies can push each other, and how stiff their contact is at first."""

import numpy as np

from solver.config import SolverConfig
from solver.contact.active import Pair, vertex_areas
from solver.contact.flatness import flat_regions
from solver.contact.pair_friction import PairFriction
from solver.model.bodies import Body, Model, RigidBody, SoftBody
from solver.model.soft import SoftSystem

CELL_STIFFNESS = 4.0  # first guess of the contact stiffness per area, in E / cell size; adapted to the target near rest
STIFFENED = 1.25  # times the penetration that is aimed at, from which on a pair is stiffened [-]
SAFE_DEPTH = 0.125  # of half of the largest thickness that is pushed into; past a half the way out is the other side


def contact_pairs(model: Model, soft: SoftSystem, config: SolverConfig, gravity: float) -> list[Pair]:
    """Every ordered pair of bodies that can push each other, with its first contact stiffness per point."""
    pairs = []
    for a, one in enumerate(model.bodies):
        for b, two in enumerate(model.bodies):
            if a == b or (one.fixed and two.fixed) or model.bonded(one, two):
                continue
            area = vertex_areas(one)
            stiffness = np.full(len(area), most_stiffness(one, two, config, gravity))
            safe_depth, flat = np.inf, None
            if isinstance(one, SoftBody) or isinstance(two, SoftBody):
                cell, modulus = softest(one, two)
                stiffness = np.minimum(stiffness, CELL_STIFFNESS * modulus / cell * np.minimum(area, cell**2))
                safe_depth = -SAFE_DEPTH * float(two.distance.values.min())
                if isinstance(one, RigidBody):
                    flat = flat_regions(one, two, cell)
            pairs.append(Pair(a, b, PairFriction.of(model, one, two), stiffness, area, safe_depth, flat))
    return pairs


def most_stiffness(one: Body, two: Body, config: SolverConfig, gravity: float) -> float:
    """Stiffness that each of three points needs to carry the load at the target penetration [N/m]: more only makes
    impacts hard."""
    load = max(body.mass for body in (one, two) if not body.fixed) * max(gravity, 1.0)
    return load / (3.0 * config.penetration_target)


def softest(one: Body, two: Body) -> tuple[float, float]:
    """Cell under the contact [m] and smallest Young's modulus [Pa] of a pair of which at least one is soft."""
    parts = [b.interior for b in (one, two) if isinstance(b, SoftBody)]
    cell = min(max(float(np.diff(p).min()) for p in s.planes) for s in parts)
    return cell, min(float(s.youngs_modulus.min()) for s in parts)
