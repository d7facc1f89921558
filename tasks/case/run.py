"""`dcap drop`: from a physics case in a YAML file to `result.json`, with a second drop where it needs one.

A second drop of a case whose bodies came to rest on a soft body outside the predicted contact.

In: the case and its rest state. Out: the rest state of a second drop from the same start, with cells of fixed bodies
that are fine at both places, or a note that explains why the first result is kept.
"""

import json
import os
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from scipy.spatial.transform import Rotation

from dcap.scene.errors import GeometryError, InputError
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.particles import Particles
from dcap.scene.writers.meshes import mesh_to_ply
from dcap.scene.written_files import JsonObject, JsonValue, draft_folder, to_json
from solver.certificate import History, Verdict
from solver.config import SolverConfig
from solver.errors import ArchError, ModelError, UnstableStep
from solver.model.bodies import Body, Model
from solver.rest import Signals
from solver.result import SettledModel
from solver.settle import settle
from solver.warmup import warm_up
from tasks.bodies.plan_contact import share_within
from tasks.bodies.proof import proven
from tasks.bodies.solver_model import solver_model
from tasks.case.bodies import case_particles, foreseen
from tasks.case.contacts import load_aware as stiffened
from tasks.case.file import Case, checked_case, read_case

FORESEEN = 0.5
"""Least share of a body's contact inside the predicted patch; below it, the actual place is resolved too [-]."""


def elsewhere(case: Case, folder: Path, result: SettledModel) -> bool:
    """Return whether a body rests on a fixed soft body with less than half of its contact on cells that are fine
    enough."""
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
    """The second drop, or None if it does not end at rest, and a note."""
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


def run_case(
    given: Path | Mapping[str, object],
    out: Path,
    *,
    solver: str = "tl",
    arch: str = "cpu",
    resolution: float | None = None,
    threads: int = 0,
    stability: bool = False,
    load_aware: bool = False,
    settings: Mapping[str, object] | None = None,
    quiet: bool = False,
) -> JsonObject:
    """Read, simulate and write a case, from a file or from a tree of its keys; returns the content of result.json.

    `settings` are further settings of the solver; the options and the case's own settings take precedence.
    """
    path = given if isinstance(given, Path) else Path("case")  # a tree's meshes are relative to the working directory
    case = read_case(given) if isinstance(given, Path) else checked_case(given, str(path))
    begin = time.perf_counter()
    chosen = resolution or (case.resolution if isinstance(case.resolution, float) else None)
    notes: list[str] = []
    try:
        if load_aware:
            case, notes = stiffened(case, path.parent, SolverConfig().penetration_target)
        particles = case_particles(case, path.parent, chosen)
        notes += particles.notes
        model = solver_model(particles, case.gravity, [(a, b) for a, b in case.bonds])
    except (ModelError, GeometryError) as error:
        raise InputError(f"{path}: {error}") from error
    bodies, cell = model.bodies, particles.resolution
    built = begin
    try:
        config = SolverConfig.model_validate(
            {
                **(settings or {}),
                "threads": threads, "seed": case.seed, "arch": arch, "method": solver, "inertia": case.inertia,
                "stability": stability,
            }
        )  # fmt: skip

        def settled(one: Model) -> SettledModel:
            return proven(one, settle(one, config, None if quiet else _progress))

        warm_up(model, config)  # compilation is not part of wall_s
        built = time.perf_counter()
        result = settled(model)
        if chosen is None and elsewhere(case, path.parent, result):
            again, told = dropped_again(case, path.parent, result, settled)
            notes.append(told)
            if again is not None:
                particles, model, result = again
                bodies = model.bodies
        cell = result.certificate.cell_m or particles.resolution
    except (ModelError, ArchError) as error:
        raise InputError(f"{path}: {error}") from error
    except UnstableStep as error:
        broken = _broken(error, bodies, cell, notes)
        broken |= {"wall_s": time.perf_counter() - built, "timings": {"build_s": built - begin}}
        write_case(out, broken, bodies, None)
        return broken
    done = time.perf_counter()
    result = replace(result, warnings=(*notes, *result.warnings))
    summary = summarise(case, bodies, result, cell)
    summary |= {"wall_s": done - built, "timings": {"build_s": built - begin, "drop_s": done - built}}
    write_case(out, summary, bodies, result)
    return summary


def _progress(step: int, seconds: float, signals: Signals) -> None:
    if step % 10 == 0:
        sys.stderr.write(
            f"step {step:4d}  t = {seconds:6.3f} s  speed {signals.speed:9.2e} m/s  "
            f"unbalanced force {signals.force_residual:8.1e}\n"
        )


def _broken(error: UnstableStep, bodies: Sequence[Body], cell: float, notes: list[str]) -> JsonObject:
    """result.json of a drop without a reliable last state; without times."""
    return {
        "verdict": "unstable_step", "bodies": {body.name: None for body in bodies}, "contacts": [], "residual": None,
        "resolution": cell, "simulated_s": None, "relaxation_steps": None, "steps": None, "particles": None,
        "certificate": None, "warnings": [*notes, str(error)],
    }  # fmt: skip


def summarise(case: Case, bodies: Sequence[Body], result: SettledModel, cell: float) -> JsonObject:
    """result.json, without times."""
    described: JsonObject = {}
    for given, body, rest in zip(case.bodies, bodies, result.bodies, strict=True):
        start = Rotation.from_quat(np.roll(given.quaternion, -1))
        turned = Rotation.from_matrix(rest.rotation) * start
        described[body.name] = {
            "position": (rest.rotation @ np.asarray(given.position) + rest.translation).tolist(),
            "quaternion": turned.as_quat(canonical=True, scalar_first=True).tolist(),
            "aabb": [rest.vertices.min(axis=0).tolist(), rest.vertices.max(axis=0).tolist()],
            "max_speed": rest.speed,
            "max_displacement": float(np.linalg.norm(rest.vertices - body.vertices, axis=1).max()),
        }
    signals = result.certificate.signals
    return {
        "verdict": result.verdict.value,
        "bodies": described,
        "contacts": to_json(result.contacts),
        "residual": {"force": signals.force_residual.value, "torque": signals.torque_residual.value},
        "resolution": cell,
        "simulated_s": result.simulated_seconds,
        "relaxation_steps": int(result.history.newton.sum()),
        "steps": result.steps,
        "particles": result.particles,
        "certificate": to_json(result.certificate),
        "warnings": list(result.warnings),
    }


def write_case(
    out: Path, summary: Mapping[str, JsonValue], bodies: Sequence[Body], result: SettledModel | None
) -> None:
    """Write the files as drafts and move them in, result.json last: once it is there, the result is complete.

    Files of an earlier result are replaced or removed; other files in the folder stay.
    """
    with draft_folder(out) as draft:
        if result is not None:
            for body, rest in zip(bodies, result.bodies, strict=True):
                (draft / f"{body.name}.ply").write_bytes(mesh_to_ply(Mesh.of(rest.vertices, body.faces)))
            pq.write_table(history_table(result.history), draft / "history.parquet")
        (draft / "result.json").write_text(json.dumps(summary, indent=2, allow_nan=False) + "\n", encoding="utf-8")
        written = [path.name for path in sorted(draft.iterdir()) if path.name != "result.json"]
        for old in {*_files_of(out), "result.json", "history.parquet"}.difference(written):
            (out / old).unlink(missing_ok=True)
        for file in [*written, "result.json"]:
            os.replace(draft / file, out / file)


def history_table(history: History) -> pa.Table:
    """A table with a column per signal and a row per step."""
    return pa.table({one.name: pa.array(getattr(history, one.name)) for one in fields(history)})


def _files_of(out: Path) -> list[str]:
    """PLY files that an earlier result.json in the folder mentions."""
    try:
        bodies = json.loads((out / "result.json").read_bytes())["bodies"]
        return [f"{name}.ply" for name in bodies if Path(name).name == name]
    except (OSError, ValueError, KeyError, TypeError):
        return []
