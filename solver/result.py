"""What a drop hands back, whichever method computed it."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from solver.model.bodies import Model

AT_REST, LEFT_TARGET, NO_EQUILIBRIUM = "at_rest", "left_target", "no_equilibrium"


@dataclass(frozen=True, eq=False, slots=True)
class RestBody:
    """One body at the end."""

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
class Result:
    """The outcome of a drop."""

    verdict: str
    """at_rest, left_target or no_equilibrium."""
    bodies: tuple[RestBody, ...]
    contacts: tuple[dict[str, object], ...]
    """Per touching pair: a, b, area_m2, normal_force_n, tangential_force_n, max_penetration_m, max_gap_m."""
    contact_points: dict[str, NDArray[np.float64]]
    """Per free body the positions of its active contact points [m], shape (k, 3)."""
    certificate: dict[str, object]
    history: dict[str, NDArray[np.float64]]
    steps: int
    simulated_seconds: float
    particles: int
    warnings: tuple[str, ...]


def carried(model: Model, touching: set[tuple[int, int]]) -> set[int]:
    """Bodies that touch something fixed, or a body that does; `touching` holds pairs of model indices."""
    out = {i for i, b in enumerate(model.bodies) if b.fixed}
    while more := {b for pair in touching if out & set(pair) for b in pair} - out:
        out |= more
    return out


def beside(model: Model, surface: NDArray[np.float64], center: NDArray[np.float64]) -> bool:
    """A body with these surface points (n, 3) lies wholly below everything fixed, or its centre of mass (3,) is beside
    it: nothing there can carry it."""
    fixed = [b.vertices for b in model.bodies if b.fixed]
    if not fixed:
        return False
    low = np.min([v.min(axis=0) for v in fixed], axis=0)
    high = np.max([v.max(axis=0) for v in fixed], axis=0)
    below = surface[:, 2].max() < low[2]
    return bool(below or ((center[:2] < low[:2]) | (center[:2] > high[:2])).any())
