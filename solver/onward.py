"""What a final state does when it is simulated on: whoever made it, the same bodies, material and law.

In: a model in its start pose, and where its bodies are said to rest. Out: how far they go from there within some
seconds of true time. A state of rest stays; what floats falls; what leans on nothing tips. Contacts begin without any
memory: they become as stiff as a drop makes them, and friction finds its elastic slip anew, so that a state of rest
settles by some hundredths of a millimetre.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from solver.config import SolverConfig
from solver.errors import ModelError
from solver.model.bodies import Model
from solver.model.state import State, best_rigid_motion
from solver.runtime import start
from solver.tl.simulation import Simulation, StepControl

Array = NDArray[np.float64]


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
    """What became of it."""

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

    Raises ModelError where it begins with bodies inside each other by more than `config.start_overlap`, and
    UnstableStep where a step breaks.
    """
    start(config.threads, config.arch)
    with threadpool_limits(1):
        simulation = Simulation(model, config)
        first = begun(simulation, placed)
        refuse_overlap(simulation, first)
        state, control, impulse, steps, work = first, StepControl(config.step_seconds), 0.0, 0, 0
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


def refuse_overlap(simulation: Simulation, state: State) -> None:
    """ModelError where bodies are inside each other by more than contact may be at the start."""
    config, query = simulation.config, simulation.query
    for touching in query.find(state, query.begin(state, config.step_seconds)).active:
        depth = float(-touching.gap.min())
        if depth > config.start_overlap:
            a, b = (simulation.model.bodies[i].name for i in (touching.pair.a, touching.pair.b))
            where = np.round(touching.position[int(np.argmin(touching.gap))], 3).tolist()
            raise ModelError(
                f"bodies {a!r} and {b!r} start {1e3 * depth:.1f} mm inside each other near {where} (bound "
                f"start_overlap = {1e3 * config.start_overlap:.1f} mm); move one of them"
            )
