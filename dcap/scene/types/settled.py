"""What the drop returns: the state at rest and its certificate, or the last state and why it is not one."""

from dataclasses import dataclass
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from dcap.scene.types.certificate import SettledCertificate, SettledContact
from dcap.scene.types.mesh import Mesh


@dataclass(frozen=True, eq=False, slots=True)
class SettledBody:
    """One body at the end."""

    name: str
    surface: Mesh
    """Deformed surface, same faces as in Particles."""
    position: NDArray[np.float64]
    """Displacement of the start pose's origin: world_from_start translation [m], shape (3,)."""
    quaternion: NDArray[np.float64]
    """world_from_start rotation (w, x, y, z), best fit for soft bodies, shape (4,)."""
    displacement: NDArray[np.float64]
    """Surface displacement from the start [m], shape (n, 3)."""


@dataclass(frozen=True, eq=False, slots=True)
class SettledHistory:
    """Signals over the run, each of shape (steps,); what they are: SettledSignals."""

    time: NDArray[np.float64]
    """[s]."""
    linear_speed: NDArray[np.float64]
    """[m/s]."""
    angular_speed: NDArray[np.float64]
    """[rad/s]."""
    particle_speed: NDArray[np.float64]
    """[m/s]."""
    force_residual: NDArray[np.float64]
    """[-]."""
    torque_residual: NDArray[np.float64]
    """[-]."""
    newton: NDArray[np.int64]
    """Newton iterations of a step; mls: explicit steps."""
    linear: NDArray[np.int64]
    """Iterations of the linear solver."""


class SettledVerdict(StrEnum):
    """How the drop ended."""

    AT_REST = "at_rest"
    LEFT_TARGET = "left_target"
    NO_EQUILIBRIUM = "no_equilibrium"


@dataclass(frozen=True, eq=False, slots=True)
class Settled:
    """The result of the drop."""

    verdict: SettledVerdict
    bodies: tuple[SettledBody, ...]
    """The object first."""
    contacts: tuple[SettledContact, ...]
    """One per touching pair."""
    contact_points: NDArray[np.float64]
    """Points of the object's contact patch [m], shape (k, 3)."""
    certificate: SettledCertificate
    history: SettledHistory
    steps: int
    simulated_seconds: float
    warnings: tuple[str, ...]


@dataclass(frozen=True, eq=False, slots=True)
class LastState:
    """What an infeasible drop keeps of the state in which it ended."""

    certificate: SettledCertificate
    contacts: tuple[SettledContact, ...]
    position: NDArray[np.float64]
    """Of the object, as in SettledBody [m], shape (3,)."""
    quaternion: NDArray[np.float64]
    """Of the object, as in SettledBody, shape (4,)."""
    steps: int
    simulated_s: float
    warnings: tuple[str, ...]
