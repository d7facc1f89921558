"""Simulate a final state further, whoever made it, with the same bodies, material and law.

In: a model in its start pose, and where its bodies are said to rest. Out: how far they go from there within some
seconds of true time. A state of rest stays; what floats falls; what leans on nothing tips. Contacts begin without any
memory: they become as stiff as a drop makes them, and friction finds its elastic slip anew, so that a state of rest
settles by some hundredths of a millimetre. What begins so deep inside something that no step could start is pushed out
first, and goes that way too: shallower overlap is pushed out by contact, to the same effect.
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
"""Depth that may remain after overlaps are pushed out [m]."""
MOST_PUSHES = 60
"""Each along the normal of the deepest point, by its depth: a corner takes a few for each of its sides."""


@dataclass(frozen=True, eq=False, slots=True)
class PlacedBodies:
    """Where bodies are at the beginning, by name; what is not named is in its start pose."""

    rotation: Mapping[str, Array] = field(default_factory=dict)
    """World-from-start rotation of rigid bodies, and of free soft ones of which no nodes are given, shape (3, 3)."""
    translation: Mapping[str, Array] = field(default_factory=dict)
    """World-from-start translation of the same [m], shape (3,)."""
    nodes: Mapping[str, NDArray[np.floating]] = field(default_factory=dict)
    """Displacement of the grid nodes of soft bodies, as in `SettledModel.nodes` [m], shape (n, 3)."""


@dataclass(frozen=True, slots=True)
class Onward:
    """Outcome of simulating a state further."""

    seconds: float
    """True time that was simulated [s]: less than asked where the steps were used up."""
    steps: int
    distance: float
    """Largest distance that the centre of mass of any free body has gone at the end [m]."""
    angle: float
    """Largest turn of any free body [rad]."""
    force_residual: float
    """Mean over the time that was asked of the unbalanced force on the worst free body over its weight [-]: 1 while
    it falls, any amount while it lands, about 0 at rest. What was not simulated counts as balanced."""


def onward(
    model: Model, config: SolverConfig, placed: PlacedBodies, seconds: float, most_steps: int, most_work: float = np.inf
) -> Onward:
    """Simulate a state on until `seconds` are over, or `most_steps`, or `most_work`: of that a step takes once the
    material points, and once more for each of its Newton iterations.

    Bodies that begin inside each other by more than `config.start_overlap` are pushed apart first. Raises ModelError
    where that finds no way out, and UnstableStep where a step breaks.
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
    """The state with everything where it was placed, at rest."""
    state, soft = simulation.start_state(), simulation.soft
    state.stop()
    for index, body in enumerate(simulation.model.bodies):
        one = simulation.soft_of.get(index)
        if one is not None:
            moved = placed.nodes.get(body.name)
            if moved is None and not body.fixed and body.name in placed.rotation:  # nobody kept more
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
    """Put a frame at a world-from-start motion."""
    state.rotation[index] = rotation
    state.center[index] = rotation @ center + translation


def apart(simulation: Simulation, state: State) -> State:
    """The state, or where bodies are too deep inside each other for a step to start, one in which free bodies are
    pushed out; ModelError where they cannot be."""
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
    """[m]."""
    way: Array
    """Of `a` out of `b` there [m], shape (3,)."""
    position: Array
    """[m], shape (3,)."""


def overlap(simulation: Simulation, state: State) -> Overlap | None:
    """Where bodies are deepest inside each other; None where they are not."""
    query, found = simulation.query, None
    for touching in query.find(state, query.begin(state, simulation.config.step_seconds)).active:
        worst = int(np.argmin(touching.gap))
        depth = float(-touching.gap[worst])
        if found is None or depth > found.depth:
            pair, way = touching.pair, depth * touching.normal[worst]
            found = Overlap(pair.a, pair.b, depth, way, touching.position[worst])
    return found


def refuse_overlap(simulation: Simulation, state: State) -> None:
    """ModelError where bodies are inside each other by more than contact may be at the start."""
    found, bound = overlap(simulation, state), simulation.config.start_overlap
    if found is not None and found.depth > bound:
        a, b = (simulation.model.bodies[i].name for i in (found.a, found.b))
        raise ModelError(
            f"bodies {a!r} and {b!r} start {1e3 * found.depth:.1f} mm inside each other near "
            f"{np.round(found.position, 3).tolist()} (bound start_overlap = {1e3 * bound:.1f} mm); move one of them"
        )
