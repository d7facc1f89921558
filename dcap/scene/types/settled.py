"""What the drop returns: the state at rest and its certificate, or the last state and why it is not one."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

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
class Settled:
    """The result of the drop."""

    verdict: str
    """at_rest, or a reason code."""
    bodies: tuple[SettledBody, ...]
    contacts: tuple[dict[str, object], ...]
    """Per touching pair, keys as in the contract."""
    contact_points: NDArray[np.float64]
    """Points of the object's contact patch [m], shape (k, 3)."""
    certificate: dict[str, object]
    """Every signal with threshold and margin."""
    history: dict[str, NDArray[np.float64]]
    """Signals over the run, each of shape (steps,)."""
    steps: int
    simulated_seconds: float
    warnings: tuple[str, ...]
