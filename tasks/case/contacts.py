"""Predicts the contacts between the bodies of a case, and makes stiff bodies rigid (`--load-aware`).

In: the solids at their start. Out: for every pair in which one body may come to lie on the other, the patch of an
elastic half-space under the gap between their true shapes. No shape is assumed.

`dcap drop --load-aware`: bodies of a case with an invisible deflection under the load become rigid.

In: a checked case. Out: the same case with `model: rigid` where the predicted deflection is below a bound, and one
sentence per changed body. Only bodies with `model: auto`; bodies requested as soft stay soft.
"""

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from dcap.arrays import Array
from dcap.geometry.raycast import Raycaster
from solver.contact.patch import deflection
from tasks.bodies.plan_contact import Layer, PlanContact, plan_contact
from tasks.case.file import Case
from tasks.case.solid import CaseSolid

MARCHES = 80  # steps of a ray along gravity to the surface of a primitive
ON_SURFACE = 1e-7  # of the body's size: nearer counts as on it [-]


@dataclass(frozen=True, eq=False, slots=True)
class PredictedContact:
    """Contact of one body on another."""

    upper: CaseSolid
    lower: CaseSolid
    plan: PlanContact

    @property
    def names(self) -> set[str]:
        """Names of both bodies."""
        return {self.upper.body.name, self.lower.body.name}

    def height_on(self, solid: CaseSolid) -> float:
        """Height of the contact [m] for a body that touches there, or is bonded to a touching body: for the lower body
        and those below it the point of first touch, else the underside of the upper body."""
        name = solid.body.name
        from_below = name == self.lower.body.name or (name != self.upper.body.name and higher(self.upper, solid))
        return self.plan.height if from_below else float(self.upper.low[2])


def predicted_contacts(solids: list[CaseSolid], gravity: float) -> list[PredictedContact]:
    """The contacts of all pairs of bodies that can press on each other, lie one above the other in plan, and have a
    soft body at or behind the contact. Contacts of bodies side by side are not predicted: cells there follow from other
    contacts."""
    found = []
    for i, one in enumerate(solids):
        for two in one.may_touch(solids[i + 1 :]):
            upper, lower = (one, two) if higher(one, two) else (two, one)
            if covered(lower, upper, solids):
                continue
            if contact := predicted_contact(upper, lower, solids, gravity):
                found.append(contact)
    return found


def predicted_contact(
    upper: CaseSolid, lower: CaseSolid, solids: list[CaseSolid], gravity: float
) -> PredictedContact | None:
    """Contact of a body on the body beneath it; None if it would fall past that body, or nothing there is soft."""
    stacks = layers(upper, solids, 1.0), layers(lower, solids, -1.0)
    box = np.stack([np.maximum(upper.low, lower.low), np.minimum(upper.high, lower.high)])[:, :2]
    load = gravity * carried_mass(upper, lower, solids)
    soft = any(compliance > 0.0 for stack in stacks for _, compliance in stack)
    if (box[0] >= box[1]).any() or load <= 0.0 or not soft:
        return None

    def gap_of(plan: Array) -> tuple[Array, Array]:
        return heights(upper, plan, 1.0), heights(lower, plan, -1.0)

    found = plan_contact(gap_of, box, load, stacks)
    return None if found is None else PredictedContact(upper, lower, found)


def higher(one: CaseSolid, two: CaseSolid) -> bool:
    """Return whether the middle of one body's box lies above the middle of the other's."""
    return bool(one.low[2] + one.high[2] > two.low[2] + two.high[2])


def covered(lower: CaseSolid, upper: CaseSolid, solids: list[CaseSolid]) -> bool:
    """Return whether bodies bonded to a body's top keep another body from reaching it."""
    between = [s for s in solids if s.body.name in lower.bonded and higher(s, lower) and higher(upper, s)]
    return any((s.low[:2] <= lower.low[:2]).all() and (s.high[:2] >= lower.high[:2]).all() for s in between)


def carried_mass(upper: CaseSolid, lower: CaseSolid, solids: list[CaseSolid]) -> float:
    """Mass [kg] that comes down on `lower` through `upper`: its own and that of the bodies on it; if the upper body is
    fixed, the mass of the lower body, which presses against it."""
    if upper.fixed:
        return lower.mass
    carried, new = [upper], [upper]
    while new:
        others = [s for s in solids if not s.fixed and s is not lower and s not in carried]
        new = [s for s in others if any(above(s, one) for one in new)]
        carried += new
    return sum(one.mass for one in carried)


def above(one: CaseSolid, two: CaseSolid) -> bool:
    """Return whether a body starts over another: their boxes overlap in plan."""
    apart = (one.low[:2] >= two.high[:2]) | (one.high[:2] <= two.low[:2])
    return not apart.any() and higher(one, two)


def heights(solid: CaseSolid, plan: Array, side: float) -> Array:
    """Height [m] at which a vertical line through each point (n, 2) enters a body from below (`side` 1) or from above
    (-1), shape (n,); nan where it misses the body."""
    begin = solid.low[2] if side > 0.0 else solid.high[2]
    size = float(np.linalg.norm(solid.extent))
    if solid.primitive is None:
        start = np.column_stack([plan, np.full(len(plan), begin - side * size)])
        hits = Raycaster(solid.surface(None, 0.0)).cast(start, np.tile([0.0, 0.0, side], (len(plan), 1)))
        return np.where(np.isfinite(hits.distance), start[:, 2] + side * hits.distance, np.nan)
    point = np.column_stack([plan, np.full(len(plan), begin)])
    for _ in range(MARCHES):
        distance = solid.exact_distance(point)
        point[:, 2] += side * np.maximum(distance, 0.0)
    missed = solid.exact_distance(point) > np.sqrt(ON_SURFACE) * size
    return np.where(missed, np.nan, point[:, 2])


def layers(solid: CaseSolid, solids: list[CaseSolid], side: float) -> list[Layer]:
    """Layers of a body and of the bodies bonded to it farther from the contact: below it (`side` -1) or above (1)."""
    found, one = [], solid
    while True:
        found.append((float(one.extent[2]), one.compliance))
        farther = [
            s for s in solids if s.body.name in one.bonded and (higher(s, one) if side > 0.0 else higher(one, s))
        ]
        if not farther:
            return found
        one = min(farther, key=lambda s: side * float(s.low[2] + s.high[2]))


def load_aware(case: Case, folder: Path, invisible: float) -> tuple[Case, list[str]]:
    """Make bodies rigid that deflect less than `invisible` [m] under the weight of all free bodies together.

    The deflection is Hertz's indentation for the smallest radius, plus bending of a bar clamped at one end, or, if the
    body is clamped at its bottom, of a bar of the body's height. Without a free body or gravity there is no load to
    predict from and nothing is changed.
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
