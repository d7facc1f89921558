"""Result of a drop by any method."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from solver.certificate import (
    Certificate,
    ContactRow,
    History,
    KickCheck,
    NotDone,
    PointForces,
    SignalRows,
    Verdict,
)
from solver.config import SolverConfig
from solver.model.bodies import Model
from solver.motion import DropFrames, MaterialState
from solver.rest import RestMonitor, history_of


@dataclass(frozen=True, eq=False, slots=True)
class RestBody:
    """Final state of one body."""

    name: str
    vertices: NDArray[np.float64]
    """Surface points [m], shape (n, 3)."""
    rotation: NDArray[np.float64]
    """World-from-start rotation, best fit for soft bodies, shape (3, 3)."""
    translation: NDArray[np.float64]
    """World-from-start translation [m], shape (3,): x = rotation @ X + translation."""
    speed: float
    """Largest speed of any of its points at the end [m/s]."""


@dataclass(frozen=True, eq=False, slots=True)
class FinalState:
    """Final state in the form that every method reports."""

    seconds: float
    """Simulated time [s]."""
    bodies: tuple[RestBody, ...]
    contacts: tuple[ContactRow, ...]
    contact_points: dict[str, NDArray[np.float64]]
    """Positions of the active contact points of each free body [m], shape (k, 3)."""
    forces: PointForces
    friction_margin: float
    """Smallest remaining share of the static friction cone [-]."""
    free_weight: float
    """Weight of the free bodies [N]."""
    inverted: int
    """Number of particles with inverted deformation."""
    particles: int


@dataclass(frozen=True, eq=False, slots=True)
class SettledModel:
    """The outcome of a drop."""

    verdict: Verdict
    bodies: tuple[RestBody, ...]
    contacts: tuple[ContactRow, ...]
    """Contacts, one per touching pair."""
    contact_points: dict[str, NDArray[np.float64]]
    """Positions of the active contact points of each free body [m], shape (k, 3)."""
    forces: PointForces
    """Forces that hold the bodies."""
    certificate: Certificate
    history: History
    frames: DropFrames
    """Recorded motion up to this state."""
    material: Mapping[str, MaterialState]
    """State of the material of the soft bodies; empty if the method does not provide it."""
    nodes: Mapping[str, NDArray[np.float32]]
    """Displacement of the grid nodes of the soft bodies [m], shape (n, 3) each; tl only."""
    steps: int
    simulated_seconds: float
    particles: int
    warnings: tuple[str, ...]


def build_result(
    verdict: Verdict,
    final: FinalState,
    monitor: RestMonitor,
    rows: SignalRows,
    kick: KickCheck | NotDone,
    config: SolverConfig,
    warnings: list[str],
    frames: DropFrames,
) -> SettledModel:
    """The result with the part of its certificate that all methods share; `rows` are the judged signals."""
    certificate = Certificate(
        arch=config.arch,
        signals=rows,
        kick=kick,
        free_weight_n=final.free_weight,
        length_m=monitor.length,
        friction_cone_margin=final.friction_margin,
        inverted_particles=final.inverted,
    )
    inverted = (f"{final.inverted} particles are inverted in the last state",) if final.inverted else ()
    return SettledModel(
        verdict=verdict,
        bodies=final.bodies,
        contacts=final.contacts,
        contact_points=final.contact_points,
        forces=final.forces,
        certificate=certificate,
        history=history_of(monitor.signals),
        frames=frames,
        material={},
        nodes={},
        steps=len(monitor.signals),
        simulated_seconds=final.seconds,
        particles=final.particles,
        warnings=(*warnings, *inverted),
    )


def carried(model: Model, touching: set[tuple[int, int]]) -> set[int]:
    """Bodies that touch a fixed body, directly or through others; `touching` holds pairs of model indices."""
    out = {i for i, b in enumerate(model.bodies) if b.fixed}
    while more := {b for pair in touching if out & set(pair) for b in pair} - out:
        out |= more
    return out


def has_left(model: Model, surface: NDArray[np.float64], center: NDArray[np.float64]) -> bool:
    """Return whether nothing can carry a body: its surface points (n, 3) all lie below every fixed body, or its centre
    of mass (3,) lies outside their bounds in plan."""
    fixed = [b.vertices for b in model.bodies if b.fixed]
    if not fixed:
        return False
    low = np.min([v.min(axis=0) for v in fixed], axis=0)
    high = np.max([v.max(axis=0) for v in fixed], axis=0)
    below = surface[:, 2].max() < low[2]
    return bool(below or ((center[:2] < low[:2]) | (center[:2] > high[:2])).any())
