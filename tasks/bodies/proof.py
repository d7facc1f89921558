"""Whether the forces that hold bodies at rest act through contacts that exist on their final surfaces.

In: the outcome of a drop, whichever method computed it. Out: the same with a `ContactProof`, and with no verdict of
rest where that fails. Distances are measured to the triangles that are shown, by a ray tracer that no solver uses.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dcap.geometry.raycast import tensor
from dcap.scene.types.mesh import Mesh
from solver.certificate import CertificateRow, ContactProof, PointForces, Verdict
from solver.model.bodies import Model, SoftBody, free_motions
from solver.result import SettledModel

Array = NDArray[np.float64]

LARGEST_GAP_M = 3e-4
"""Of tl: six times the penetration that its contacts aim at, and invisible in any picture [m]."""
CELL_SHARE, LARGEST_MLS_GAP_M = 0.1, 1e-3
"""Of mls: this share of its cell, and never more than that [-], [m]."""
LARGEST_IMBALANCE = 0.01
"""What of a body's weight may be held by nothing that is seen [-]."""
COUNTED = 0.9
"""Share of the force between two bodies whose points are force-carrying [-]: where a rim bends a surface, its triangles
are chords, some tenths of a millimetre beside it."""
SIDE_SHARE = 0.03
"""How far the triangles of a soft body's surface may lie beside the curved surface that contact sees, over their sides
[-]."""
FARTHEST_M = 1e-3
"""A force that acts farther from a surface than this holds nothing [m]."""


def proven(model: Model, result: SettledModel) -> SettledModel:
    """The outcome with its proof; one at rest that the surfaces do not bear out has found no equilibrium."""
    surfaces = [Mesh.of(end.vertices, body.faces) for end, body in zip(result.bodies, model.bodies, strict=True)]
    largest = LARGEST_GAP_M
    if result.certificate.cell_m is not None:
        largest = min(CELL_SHARE * result.certificate.cell_m, LARGEST_MLS_GAP_M)
    proof = contact_proof(model, surfaces, result.forces, largest)
    certificate = replace(result.certificate, proof=proof)
    if result.verdict is not Verdict.AT_REST or proof.holds:
        return replace(result, certificate=certificate)
    warnings = (*result.warnings, refutation(proof))
    return replace(result, certificate=certificate, verdict=Verdict.NO_EQUILIBRIUM, warnings=warnings)


def refutation(proof: ContactProof) -> str:
    """Why a state is not at rest although nothing moves; empty where the proof holds."""
    if not proof.gap_m.holds:
        gap, most = 1e3 * proof.gap_m.value, 1e3 * proof.gap_m.threshold
        return f"forces that hold it act {gap:.3g} mm beside the surfaces (at most {most:.3g} mm)"
    if not proof.imbalance.holds:
        return f"{proof.imbalance.value:.1%} of what a body weighs or carries is held by nothing that touches it"
    return ""


def contact_proof(model: Model, surfaces: Sequence[Mesh], forces: PointForces, largest_gap: float) -> ContactProof:
    """Measure on the final surfaces, one for each body, where forces act and what they hold."""
    size = np.linalg.norm(forces.force, axis=1)
    gap, allowed = np.zeros(len(size)), np.full(len(size), largest_gap)
    numbers = bool(np.isfinite(forces.force).all() and np.isfinite(forces.position).all())
    touching = ~forces.bonded & (size > 0.0) & numbers  # of a state that holds other values nothing is proven
    for which in (forces.a, forces.b):
        for index in np.unique(which[touching]).tolist():
            mine = np.flatnonzero(touching & (which == index))
            away, side = distances(surfaces[index], forces.position[mine])
            gap[mine] = np.maximum(gap[mine], away)
            if isinstance(model.bodies[index], SoftBody):
                allowed[mine] = np.maximum(allowed[mine], np.minimum(SIDE_SHARE * side, FARTHEST_M))
    rows = [CertificateRow.at_most(0.0, largest_gap)]
    pair = np.sort(np.column_stack([forces.a, forces.b]), axis=1)
    for one in np.unique(pair[touching], axis=0):
        mine = np.flatnonzero(touching & (pair == one).all(axis=1))
        order = mine[np.argsort(gap[mine] / allowed[mine], kind="stable")]
        before = np.cumsum(size[order]) - size[order]
        last = order[before < COUNTED * size[order].sum()][-1]
        rows.append(CertificateRow.at_most(float(gap[last]), float(allowed[last])))
    rest = max(imbalances(model, forces, forces.bonded | (touching & (gap <= FARTHEST_M))), default=0.0)
    return ContactProof(
        int(touching.sum()), min(rows, key=lambda row: row.margin), CertificateRow.at_most(rest, LARGEST_IMBALANCE)
    )


def distances(mesh: Mesh, points: Array) -> tuple[Array, Array]:
    """Distance of points (k, 3) from a surface, and the longest side of the triangle that each is nearest to [m]."""
    import open3d

    middle = points.mean(axis=0)  # single precision is finest around the origin
    scene = open3d.t.geometry.RaycastingScene()
    scene.add_triangles(tensor(mesh.vertices - middle, np.float32), tensor(mesh.faces, np.uint32))
    found = scene.compute_closest_points(tensor(points - middle, np.float32), nthreads=1)
    away = np.linalg.norm(found["points"].numpy().astype(np.float64) - (points - middle), axis=1)
    corner = mesh.vertices[mesh.faces[found["primitive_ids"].numpy()]]
    side = np.linalg.norm(corner - np.roll(corner, 1, axis=1), axis=2).max(axis=1)
    return away, side


def imbalances(model: Model, forces: PointForces, valid: NDArray[np.bool_]) -> Iterator[float]:
    """Unbalanced force on each free body over its weight, or what it carries where that is more, by valid points."""
    heaviest = max((body.mass for body in model.bodies if not body.fixed), default=0.0) * model.gravity_strength
    for index, body in enumerate(model.bodies):
        if body.fixed:
            continue
        own = np.concatenate([forces.force[valid & (forces.a == index)], -forces.force[valid & (forces.b == index)]])
        weight = body.mass * model.gravity_strength
        carried = 0.5 * float(np.linalg.norm(own, axis=1).sum() - np.linalg.norm(own.sum(axis=0)))
        scale = min(max(weight, carried), heaviest)
        rest = (own.sum(axis=0) + body.mass * model.gravity) * free_motions(body)[:3]
        yield float(np.linalg.norm(rest)) / scale
