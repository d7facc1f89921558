"""Checks that the forces that hold bodies at rest act through contacts that exist on their final surfaces.

In: the outcome of a drop by any method. Out: the same outcome with a `ContactProof`; if the proof fails, the outcome is
no longer at rest. Distances are measured to the triangles on which contact was evaluated, by code that no method of the
solver uses while it computes. Only the centre of mass of a soft body is that of the material that the method reports.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from dcap.arrays import Array
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.outcome import Cause, Caution
from solver.certificate import Certificate, CertificateRow, ContactProof, PointForces, Verdict
from solver.errors import UnstableStep
from solver.model.bodies import Body, Model, SoftBody, free_motions
from solver.model.state import best_rigid_motion
from solver.result import SettledModel
from tasks.bodies.overlap import Nearest, largest_push, nearest, overlap_row, sides_of, worst_row

LARGEST_GAP_M = 3e-4
"""Largest gap for tl: six times the penetration that its contacts aim at, and invisible in any picture [m]."""
CELL_SHARE, LARGEST_MLS_GAP_M = 0.1, 1e-3
"""Largest gap for mls: this share of its cell, and never more than the second value [-], [m]."""
LARGEST_IMBALANCE = 0.01
"""Largest share of a body's weight that may be held by no visible contact [-]."""
COUNTED = 0.9
"""Share of the force between two bodies whose points count as force-carrying [-]: where a rim bends a surface, its
triangles are chords, some tenths of a millimetre off the surface."""
SIDE_SHARE = 0.03
"""Largest distance between a triangle of a soft body and the curved surface that contact sees, over its side [-]."""
STRAIN = 0.2
"""Largest motion of a place inside a soft body relative to the surface there, over its depth [-]."""
FARTHEST_M = 1e-3
"""A force that acts farther from a surface than this holds nothing, and no surface may lie deeper in a body [m]."""

PULL = 0.2
"""Share of a force that may pull at the first body's faces: normals of two faces are not quite opposite [-]."""
CONE, UNEVEN = 2.0, 0.1
"""Tolerances for flat triangles on curved surfaces: factor on the friction of the bodies, and amount by which the
normal share of forces may fall below that of the resulting cone [-]."""

TINY = np.finfo(float).tiny


def proven(model: Model, result: SettledModel) -> SettledModel:
    """The outcome with its proof; a state of rest that the surfaces do not confirm becomes "no equilibrium found".
    Raises UnstableStep for a state that is not finite."""
    require_finite(model, result)
    surfaces = [Mesh.of(end.vertices, body.faces) for end, body in zip(result.bodies, model.bodies, strict=True)]
    proof = contact_proof(
        model, surfaces, result.forces, largest_gap(result.certificate), material_centers(model, result)
    )
    proof = replace(proof, smallest_area_m2=smallest_area(model, result))
    certificate = replace(result.certificate, proof=proof)
    if result.verdict is not Verdict.AT_REST or proof.holds:
        return replace(result, certificate=certificate)
    warnings = (*result.warnings, Caution(Cause.NOT_MET, refutation(proof)))
    return replace(result, certificate=certificate, verdict=Verdict.NO_EQUILIBRIUM, warnings=warnings)


def smallest_area(model: Model, result: SettledModel) -> float | None:
    """Smallest area of a contact that carries force and has a soft body on one side [m^2]; None if there is none."""
    soft = {body.name for body in model.bodies if isinstance(body, SoftBody)}
    areas = [row.area_m2 for row in result.contacts if row.normal_force_n > 0.0 and {row.a, row.b} & soft]
    return float(np.min(areas)) if areas else None


def material_centers(model: Model, result: SettledModel) -> dict[str, Array]:
    """Centres of mass of the soft bodies at the end, from the motion of their material [m], shape (3,) each."""
    found = {}
    for body in model.bodies:
        if isinstance(body, SoftBody) and body.name in result.material:
            material = result.material[body.name]
            mass = material.volume * body.interior.density
            found[body.name] = body.center_of_mass + mass @ material.displacement / mass.sum()
    return found


def require_finite(model: Model, result: SettledModel) -> None:
    """Raise UnstableStep that names the first quantity in a final state that is not finite."""
    for end in result.bodies:
        if not np.isfinite(end.vertices).all():
            raise UnstableStep(f"the surface of body {end.name!r} at the end is not finite")
    for name, material in result.material.items():
        if not np.isfinite(material.displacement).all():
            raise UnstableStep(f"the material of body {name!r} at the end is not finite")
    forces = result.forces
    broken = np.flatnonzero(~(np.isfinite(forces.force) & np.isfinite(forces.position)).all(axis=1))
    if len(broken):
        a, b = (model.bodies[int(which[broken[0]])].name for which in (forces.a, forces.b))
        raise UnstableStep(f"a force between {a!r} and {b!r} at the end is not finite")


def largest_gap(certificate: Certificate) -> float:
    """Largest distance from a surface at which a force may act [m]: larger for mls, whose cells are coarser."""
    if certificate.cell_m is None:
        return LARGEST_GAP_M
    return min(CELL_SHARE * certificate.cell_m, LARGEST_MLS_GAP_M)


def refutation(proof: ContactProof) -> str:
    """Reason why a motionless state is not at rest; empty if the proof holds."""
    if not proof.gap_m.holds:
        gap, most = 1e3 * proof.gap_m.value, 1e3 * proof.gap_m.threshold
        return f"forces that hold it act {gap:.3g} mm off the surfaces (at most {most:.3g} mm)"
    if not proof.overlap_m.holds:
        deep, most = 1e3 * proof.overlap_m.value, 1e3 * proof.overlap_m.threshold
        return f"a surface lies {deep:.3g} mm deep in another body (at most {most:.3g} mm)"
    if proof.smallest_area_m2 is not None and not proof.smallest_area_m2 > 0.0:
        return "a contact that carries a soft body, or is carried by one, has no area"
    if not proof.imbalance.holds and proof.points == 0:
        return "no known force holds it where it is"
    if not proof.imbalance.holds:
        return f"no contact holds {proof.imbalance.value:.1%} of a body's load or of its torque"
    return ""


def contact_proof(
    model: Model,
    surfaces: Sequence[Mesh],
    forces: PointForces,
    largest_gap: float,
    centers: Mapping[str, Array],
) -> ContactProof:
    """Measure on the final surfaces, one per body, where forces act, how much they hold, and where bodies overlap.

    Args:
        model: the bodies at the start.
        surfaces: their surfaces at the end.
        forces: all forces between them.
        largest_gap: largest distance of a force from an exact surface [m].
        centers: centres of mass of bodies that bend [m]; the others moved as a whole.
    """
    at = places(model, surfaces, forces, largest_gap)
    size = np.linalg.norm(forces.force, axis=1)
    touching = ~forces.bonded & (size > 0.0)
    torn = np.linalg.norm(at.start[0] - at.start[1], axis=1) > FARTHEST_M + STRAIN * at.distance.max(axis=0)
    pushed = touching & (at.distance <= FARTHEST_M).all(axis=0) & pushing_points(forces, at)
    valid = pushed | (forces.bonded & ~torn)
    shares = np.array([0.0, *imbalances(model, surfaces, forces, valid, centers)])
    return ContactProof(
        int(touching.sum()),
        largest_gap_row(forces, at, largest_gap),
        CertificateRow.at_most(float(shares.max()), LARGEST_IMBALANCE),
        overlap_row(model, surfaces, largest_gap, FARTHEST_M),
    )


@dataclass(frozen=True, eq=False, slots=True)
class Places:
    """Places of k forces on the surfaces of their two bodies: rows are those of `a`, then of `b`."""

    distance: Array
    """Distances from the two surfaces [m], shape (2, k)."""
    allowed: Array
    """Largest allowed distances [m], shape (2, k)."""
    friction: Array
    """Static friction of the two faces [-], shape (2, k); of the pair of bodies on both sides, if that is set."""
    push: Array
    """The force on `a`, or on `b`, along the inward normal there [N], shape (2, k)."""
    start: Array
    """Places at the start, assuming that they moved with the surface [m], shape (2, k, 3)."""


def places(model: Model, surfaces: Sequence[Mesh], forces: PointForces, largest_gap: float) -> Places:
    """Find where forces act on the final surfaces."""
    count = len(forces.force)
    at = Places(
        np.zeros((2, count)), np.full((2, count), largest_gap), np.zeros((2, count)), np.zeros((2, count)),
        np.zeros((2, count, 3)),
    )  # fmt: skip
    acting = forces.bonded | (forces.force != 0.0).any(axis=1)
    for row, (which, sign) in enumerate(((forces.a, 1.0), (forces.b, -1.0))):
        for index in np.unique(which[acting]).tolist():
            mine = np.flatnonzero(acting & (which == index))
            body, surface, points = model.bodies[index], surfaces[index], forces.position[mine]
            near = nearest(surface, points)
            sides = sides_of(Mesh.of(body.vertices, surface.faces), surface, body.distance, near)
            at.push[row, mine] = largest_push(sides, near, sign * forces.force[mine])
            at.start[row, mine] = started(body, surface, points, near)
            at.distance[row, mine] = near.distance
            rows = body.face_friction
            at.friction[row, mine] = body.static_friction if rows is None else rows[near.face, 0]
            if isinstance(body, SoftBody):
                at.allowed[row, mine] = np.maximum(largest_gap, np.minimum(SIDE_SHARE * near.side, FARTHEST_M))
    for a, b in np.unique(np.column_stack([forces.a, forces.b]), axis=0).tolist():
        given = model.given_friction(model.bodies[a], model.bodies[b])
        if given is not None:
            at.friction[:, (forces.a == a) & (forces.b == b)] = given[0]
    return at


def pushing_points(forces: PointForces, at: Places) -> NDArray[np.bool_]:
    """Mask of the forces that push at the surfaces of both bodies, shape (k,): their sum lies inside the friction cones
    of both."""
    size = np.linalg.norm(forces.force, axis=1)
    ordered = np.column_stack([forces.a, forces.b])
    touching = ~forces.bonded & (size > 0.0)
    pushed: NDArray[np.bool_] = touching & (at.push[0] >= -PULL * size) & (at.push[1] >= 0.0)
    least = size * (1.0 / np.hypot(1.0, CONE * np.sqrt(at.friction.prod(axis=0))) - UNEVEN)
    for pair in np.unique(ordered[touching], axis=0):
        mine = pushed & (ordered == pair).all(axis=1)
        if (at.push[:, mine].sum(axis=1) < least[mine].sum()).any():
            pushed &= ~mine
    return pushed


def largest_gap_row(forces: PointForces, at: Places, largest_gap: float) -> CertificateRow:
    """Row for the distance of forces from the surfaces, for the pair of bodies nearest to its limit."""
    size = np.linalg.norm(forces.force, axis=1)
    pair = np.sort(np.column_stack([forces.a, forces.b]), axis=1)
    touching = ~forces.bonded & (size > 0.0)
    rows = [CertificateRow.at_most(0.0, largest_gap)]
    share = at.distance / at.allowed
    side = np.argmax(share, axis=0)
    for one in np.unique(pair[touching], axis=0):
        mine = np.flatnonzero(touching & (pair == one).all(axis=1))
        order = mine[np.argsort(share[:, mine].max(axis=0), kind="stable")]
        before = np.cumsum(size[order]) - size[order]
        last = order[before < COUNTED * size[order].sum()][-1]
        rows.append(CertificateRow.at_most(float(at.distance[side[last], last]), float(at.allowed[side[last], last])))
    return worst_row(rows)


def started(body: Body, surface: Mesh, points: Array, near: Nearest) -> Array:
    """Start positions of places (k, 3) that move with the nearest triangle of a body [m]."""
    corners = body.faces[near.face]
    before, now = body.vertices[corners], surface.vertices[corners]
    off = points - np.einsum("kc,kci->ki", near.weight, now)
    turned_back = np.einsum("kij,klj,kl->ki", frames(before), frames(now), off)
    start: Array = np.einsum("kc,kci->ki", near.weight, before) + turned_back
    return start


def frames(corner: Array) -> Array:
    """An orthonormal frame of each triangle (k, 3, 3), as columns: along its first side, its normal, and across."""
    side, other = corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]
    normal = np.cross(side, other)
    one, two = (v / np.maximum(np.linalg.norm(v, axis=1, keepdims=True), TINY) for v in (side, normal))
    return np.stack([one, two, np.cross(one, two)], axis=2)


def imbalances(
    model: Model,
    surfaces: Sequence[Mesh],
    forces: PointForces,
    valid: NDArray[np.bool_],
    centers: Mapping[str, Array],
) -> Iterator[float]:
    """Yield the imbalance of each free body under valid forces [-].

    Force counts over the body's weight, or over the load that it carries if that is larger; along gravity only vertical
    forces are load, so squeezing carries no weight. Torque about its centre of mass counts over that larger force times
    half its size, less what rolling resistance may hold: the force times the largest lever of the surfaces. A body
    without a valid force is not held at all.
    """
    heaviest = max((body.mass for body in model.bodies if not body.fixed), default=0.0) * model.gravity_strength
    down = model.gravity / max(model.gravity_strength, TINY)
    for index, body in enumerate(model.bodies):
        if body.fixed:
            continue
        first, second = valid & (forces.a == index), valid & (forces.b == index)
        own = np.concatenate([forces.force[first], -forces.force[second]])
        weight = body.mass * model.gravity_strength
        if len(own) == 0:
            yield float(np.linalg.norm(model.gravity) > 0.0)
            continue
        scale = min(max(weight, load_through(own)), heaviest)
        scale_along = min(max(weight, load_through((own @ down)[:, None])), heaviest)
        rest = (own.sum(axis=0) + body.mass * model.gravity) * free_motions(body)[:3]
        along = float(rest @ down)
        yield float(np.hypot(along / scale_along, np.linalg.norm(rest - along * down) / scale))
        partners = {index, *forces.a[second].tolist(), *forces.b[first].tolist()}
        lever = max(float(model.bodies[one].friction_rows[:, 2].max()) for one in partners)
        position = np.concatenate([forces.position[first], forces.position[second]])
        center = centers.get(body.name)
        if center is None:
            every = np.ones(len(body.vertices))
            rotation, translation = best_rigid_motion(body.vertices, surfaces[index].vertices, every)
            center = rotation @ body.center_of_mass + translation
        arm = position - center
        torque = np.linalg.norm(np.cross(arm, own).sum(axis=0) * free_motions(body)[3:])
        yield max(float(torque) / scale - lever, 0.0) / (0.5 * body.size)


def load_through(force: Array) -> float:
    """Load that forces (k, n) on a body pass on to others [N]: half of the part that cancels in their sum."""
    return 0.5 * float(np.linalg.norm(force, axis=1).sum() - np.linalg.norm(force.sum(axis=0)))
