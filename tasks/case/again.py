"""A second drop of a case whose bodies came to rest on a soft body outside the predicted contact.

In: the case and its rest state. Out: the rest state of a drop from the same start with cells of fixed bodies that are
fine at both places, or a note why the first one stays.
"""

from collections.abc import Callable
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from dcap.scene.errors import GeometryError
from dcap.scene.types.particles import Particles
from solver.certificate import Verdict
from solver.errors import ModelError, UnstableStep
from solver.model.bodies import Model
from solver.result import SettledModel
from tasks.bodies.plan_contact import share_within
from tasks.bodies.solver_model import solver_model
from tasks.case.bodies import case_particles, foreseen
from tasks.case.file import Case

FORESEEN = 0.5
"""Least share of a body's contact inside the predicted patch; else its place is resolved too [-]."""


def elsewhere(case: Case, folder: Path, result: SettledModel) -> bool:
    """Whether a body rests on a fixed soft one with less than half of its contact on cells that are fine for it."""
    if result.verdict is not Verdict.AT_REST:
        return False
    solids, contacts = foreseen(case, folder)
    soft = {one.body.name for one in solids if one.fixed and not one.rigid}
    for solid in solids:
        name = solid.body.name
        rows = [row for row in result.contacts if name in (row.a, row.b)]
        carried = sum(row.normal_force_n for row in rows if soft & {row.a, row.b})
        if solid.fixed or carried <= 0.5 * sum(row.normal_force_n for row in rows):
            continue
        own = [box for one in contacts if name in one.names and soft & one.names for box in one.plan.boxes]
        boxes = np.array(own).reshape(-1, 2, 2)
        if share_within(result.contact_points[name], boxes) < FORESEEN:
            return True
    return False


def dropped_again(
    case: Case, folder: Path, first: SettledModel, settle: Callable[[Model], SettledModel]
) -> tuple[tuple[Particles, Model, SettledModel] | None, str]:
    """The second drop, None if it does not end at rest, and a note."""
    rolled = "bodies came to rest outside the predicted contact"
    try:
        particles = case_particles(case, folder, None, as_ended(case, first))
        model = solver_model(particles, case.gravity, [(a, b) for a, b in case.bonds])
        result = settle(model)
    except (UnstableStep, GeometryError, ModelError) as error:
        return None, f"{rolled}, with coarse cells; a second drop with fine ones there failed: {error}"
    if result.verdict is not Verdict.AT_REST:
        return None, f"{rolled}, with coarse cells; a second drop with fine ones there ended as {result.verdict}"
    return (particles, model, result), f"{rolled}: dropped again with fine cells there"


def as_ended(case: Case, result: SettledModel) -> Case:
    """The case with its bodies in their rest positions."""
    moved = []
    for body, rest in zip(case.bodies, result.bodies, strict=True):
        turned = Rotation.from_matrix(rest.rotation) * Rotation.from_quat(body.quaternion, scalar_first=True)
        place = rest.rotation @ np.asarray(body.position) + rest.translation
        update = {"position": place.tolist(), "quaternion": turned.as_quat(scalar_first=True).tolist()}
        moved.append(body.model_copy(update=update))
    return case.model_copy(update={"bodies": moved})
