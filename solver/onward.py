"""Continue the simulation of a final state, whatever its origin, with the same bodies, material and law.

In: a model in its start pose, and the claimed rest poses of its bodies. Out: the distance that they move from there
within some seconds of true time. A state of rest stays; a floating body falls; a body that leans on nothing tips over.
Contacts begin without memory: they become as stiff as a drop makes them, and friction builds up its elastic slip again,
so that a state of rest settles by some hundredths of a millimetre. Overlaps too deep for a step to start are resolved
first by moving the body out, and count as motion too: contact pushes shallower overlaps out with the same effect.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from solver.arrays import Array
from solver.config import SolverConfig
from solver.errors import ModelError
from solver.model.bodies import Model
from solver.model.state import State, best_rigid_motion
from solver.runtime import start
from solver.tl.simulation import Simulation, StepControl

FLUSH = 1e-4
"""Depth that may remain after overlaps are resolved [m]."""
MOST_PUSHES = 60
"""Maximum number of pushes, each along the normal of the deepest point by its depth: a corner takes a few per side."""


@dataclass(frozen=True, eq=False, slots=True)
class PlacedBodies:
    """Initial places of bodies, by name; a body that is not named is in its start pose."""

    rotation: Mapping[str, Array] = field(default_factory=dict)
    """World-from-start rotation of rigid bodies, and of free soft bodies without given nodes, shape (3, 3)."""
    translation: Mapping[str, Array] = field(default_factory=dict)
    """World-from-start translation of the same bodies [m], shape (3,)."""
    nodes: Mapping[str, NDArray[np.floating]] = field(default_factory=dict)
    """Displacement of the grid nodes of soft bodies, as in `SettledModel.nodes` [m], shape (n, 3)."""


@dataclass(frozen=True, slots=True)
class Onward:
    """Outcome of a continued simulation."""

    seconds: float
    """Simulated true time [s]: less than requested if the steps were used up."""
    steps: int
    distance: float
    """Largest final displacement of the centre of mass of any free body [m]."""
    angle: float
    """Largest turn of any free body [rad]."""
    force_residual: float
    """Unbalanced force on the worst free body over its weight, averaged over the requested time [-]: 1 during free
    fall, any value during a landing, about 0 at rest. Time that was not simulated counts as balanced."""


def onward(
    model: Model, config: SolverConfig, placed: PlacedBodies, seconds: float, most_steps: int, most_work: float = np.inf
) -> Onward:
    """Continue the simulation of a state until `seconds` are over, or `most_steps`, or `most_work`: a step costs the
    number of material points, and again as much for each of its Newton iterations.

    Bodies that begin inside each other by more than `config.start_overlap` are first pushed apart. Raises ModelError if
    that fails, and UnstableStep if a step breaks.
    """
    start(config.threads, config.arch)
    with threadpool_limits(1):
        simulation = Simulation(model, config)
        first = begun(simulation, placed)
        state = apart(simulation, first)
        control, impulse, steps, work = StepControl(config.step_seconds), 0.0, 0, 0
        while state.time < seconds - 1e-9 and steps < most_steps and work < most_work:
            control = replace(control, dt=min(control.dt, seconds - state.time))
            step = simulation.step(state, control)
            impulse += float(step.signals.force_residual) * (step.state.time - state.time)
            state, control, steps = step.state, step.control, steps + 1
            work += (1 + step.report.newton) * len(simulation.soft.real)
            simulation.stiffen(state, step.report.contacts, step.signals)
        distance, angle = simulation.distance(first, state)
        return Onward(float(state.time), steps, distance, angle, impulse / seconds)


def begun(simulation: Simulation, placed: PlacedBodies) -> State:
    """The state with all bodies at their given places, at rest."""
    state, soft = simulation.start_state(), simulation.soft
    state.stop()
    for index, body in enumerate(simulation.model.bodies):
        one = simulation.soft_of.get(index)
        if one is not None:
            moved = placed.nodes.get(body.name)
            if moved is None and not body.fixed and body.name in placed.rotation:  # no nodes are known
                rest = soft.rest[one.nodes]
                moved = rest @ placed.rotation[body.name].T + placed.translation[body.name] - rest
            if moved is not None:
                state.x[one.nodes] = soft.rest[one.nodes] + moved
                core = np.flatnonzero(soft.core[one.nodes] == index)
                if len(core):
                    own = soft.rest[one.nodes][core], state.x[one.nodes][core]
                    place(state, index, body.center_of_mass, *best_rigid_motion(*own, np.ones(len(core))))
        elif body.name in placed.rotation:
            place(state, index, body.center_of_mass, placed.rotation[body.name], placed.translation[body.name])
    return state


def place(state: State, index: int, center: Array, rotation: Array, translation: Array) -> None:
    """Place a frame by a world-from-start motion."""
    state.rotation[index] = rotation
    state.center[index] = rotation @ center + translation


def apart(simulation: Simulation, state: State) -> State:
    """The state; if bodies are too deep inside each other for a step to start, a state in which free bodies have been
    pushed out. Raises ModelError if they cannot be."""
    deepest = overlap(simulation, state)
    if deepest is None or deepest.depth <= simulation.config.start_overlap:
        return state
    state = state.copy()
    for _ in range(MOST_PUSHES):
        if deepest is None or deepest.depth <= FLUSH:
            return state
        moves_a = deepest.a in simulation.free
        if not moves_a and deepest.b not in simulation.free:
            break
        index, way = (deepest.a, deepest.way) if moves_a else (deepest.b, -deepest.way)
        push(simulation, state, index, way)
        deepest = overlap(simulation, state)
    refuse_overlap(simulation, state)
    return state


def push(simulation: Simulation, state: State, index: int, way: Array) -> None:
    """Move a free body as a whole by `way` [m], shape (3,)."""
    state.center[index] += way
    if (one := simulation.soft_of.get(index)) is not None:
        state.x[one.nodes] += way


@dataclass(frozen=True, eq=False, slots=True)
class Overlap:
    """The deepest point of one body in another."""

    a: int
    b: int
    depth: float
    """Depth of the point [m]."""
    way: Array
    """Direction that moves `a` out of `b` there [m], shape (3,)."""
    position: Array
    """Position of the point [m], shape (3,)."""


def overlap(simulation: Simulation, state: State) -> Overlap | None:
    """The deepest overlap of bodies; None if there is none."""
    query, found = simulation.query, None
    for touching in query.find(state, query.begin(state, simulation.config.step_seconds)).active:
        worst = int(np.argmin(touching.gap))
        depth = float(-touching.gap[worst])
        if found is None or depth > found.depth:
            pair, way = touching.pair, depth * touching.normal[worst]
            found = Overlap(pair.a, pair.b, depth, way, touching.position[worst])
    return found


def refuse_overlap(simulation: Simulation, state: State) -> None:
    """Raise ModelError if bodies overlap by more than contact allows at the start."""
    found, bound = overlap(simulation, state), simulation.config.start_overlap
    if found is not None and found.depth > bound:
        a, b = (simulation.model.bodies[i].name for i in (found.a, found.b))
        raise ModelError(
            f"bodies {a!r} and {b!r} start {1e3 * found.depth:.1f} mm inside each other near "
            f"{np.round(found.position, 3).tolist()} (bound start_overlap = {1e3 * bound:.1f} mm); move one of them"
        )
