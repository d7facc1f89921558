"""Result of the drop: the state at rest and its certificate, or the last state and why it is not at rest."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from dcap.scene.types.mesh import Mesh
from dcap.scene.types.particles import ColumnLayer
from solver.certificate import Certificate, CertificateRow, ContactRow, History, Verdict
from solver.motion import DropFrames, MaterialState


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

    @property
    def world_from_start(self) -> NDArray[np.float64]:
        """Rigid motion of its start pose, shape (4, 4)."""
        pose = np.eye(4)
        pose[:3, :3] = Rotation.from_quat(self.quaternion, scalar_first=True).as_matrix()
        pose[:3, 3] = self.position
        return pose


@dataclass(frozen=True, slots=True)
class LeanCheck:
    """Leaning of the object: request and result."""

    on: str
    """Instance id, or 'part:NAME' of the base, that it should lean on."""
    asked_rad: float
    """Tilt of its upright axis from the vertical at the start [rad]."""
    rest_rad: float
    """Tilt of its upright axis from the vertical at rest [rad]."""
    change_rad: CertificateRow
    """The difference of the two."""
    held_share: CertificateRow
    """Normal force between the object and the thing that it leans on over all normal force on it; for a part of the
    base the share of the contact's points above the object's foot [-]."""


@dataclass(frozen=True, slots=True)
class PoseCheck:
    """A requested pose or facing, and the result."""

    asked: str
    """upright, on_back ...; `facing ID`; `turned by N degrees`."""
    found: str
    """Pose at rest, in the same words; for a facing its angular error."""
    angle_rad: float
    """Angle between the requested and the actual direction [rad]."""
    threshold_rad: float
    """Largest angle that meets it [rad]."""
    met: bool
    doubt: str = ""
    """Why the shape does not determine whether it is met; empty: it does."""


@dataclass(frozen=True, slots=True)
class PlacementChecks:
    """Requirements on the rest state, with their results."""

    carried_share: CertificateRow
    """Share of the object's weight that the base carries [-]."""
    tilt_rad: CertificateRow | None = None
    """Change of the object's tilt, if an orientation was requested."""
    turn_rad: CertificateRow | None = None
    """Turn about the vertical, if a facing was requested."""
    lean: LeanCheck | None = None
    """Leaning, if requested."""
    column: tuple[ColumnLayer, ...] | None = None
    """Layers of a soft base under the predicted contact, from the top down."""
    foreseen_share: CertificateRow | None = None
    """Share of the contact's points inside the predicted patch, where cells are fine [-]; None unless most of the force
    on the object is by soft bodies, and for a leaning object."""
    poses: tuple[PoseCheck, ...] = ()
    """Every requested pose and facing, in the words of the request."""
    indentation_m: float = 0.0
    """Largest downward displacement of the base's surface since the start [m]: depth of the dent; 0 on a rigid base."""


@dataclass(frozen=True, eq=False, slots=True)
class Settled:
    """The result of the drop."""

    verdict: Verdict
    bodies: tuple[SettledBody, ...]
    """The object first."""
    contacts: tuple[ContactRow, ...]
    """One per touching pair."""
    contact_points: NDArray[np.float64]
    """Points of the object's contact patch [m], shape (k, 3)."""
    certificate: Certificate | None
    """None if nothing was simulated: the pose is only a proposal."""
    history: History
    steps: int
    simulated_seconds: float
    warnings: tuple[str, ...]
    checks: PlacementChecks | None = None
    """None before the rest state is compared with the request."""
    frames: DropFrames | None = None
    """Frames of the bodies' motion, in their order; None if not kept."""
    material: tuple[MaterialState | None, ...] = ()
    """Material of each body, None for rigid ones; empty if the method does not return it."""
    nodes: tuple[NDArray[np.float32] | None, ...] = ()
    """Displacement of the nodes of each body's grid [m], shape (n, 3), None for rigid ones; empty as `material`."""


@dataclass(frozen=True, eq=False, slots=True)
class LastState:
    """Part of the last state that an infeasible drop keeps."""

    certificate: Certificate
    contacts: tuple[ContactRow, ...]
    position: NDArray[np.float64]
    """Position of the object, as in SettledBody [m], shape (3,)."""
    quaternion: NDArray[np.float64]
    """Quaternion of the object, as in SettledBody, shape (4,)."""
    steps: int
    simulated_s: float
    warnings: tuple[str, ...]
    checks: PlacementChecks


@dataclass(frozen=True, slots=True)
class EndPose:
    """Pose of the object at the end of a drop, as in SettledBody: a second drop has fine cells there."""

    position: tuple[float, float, float]
    """[m]."""
    quaternion: tuple[float, float, float, float]


@dataclass(frozen=True, slots=True)
class SettledMaterial:
    """Final state of one soft body."""

    body: str
    points: int
    """Material points."""
    volume_before_m3: float
    """Volume of the material before the drop."""
    volume_m3: float
    """Volume of the material at rest."""
    largest_displacement_m: float
    largest_stress_pa: float
    """Von Mises stress."""
    surface_to_points_mean_m: float
    """Distance of the settled surface's vertices from the nearest material point."""
    surface_to_points_max_m: float


def surface_at(settled: Settled, body: int, frame: int) -> NDArray[np.float64]:
    """Surface points of a body at a frame [m], shape (n, 3)."""
    assert settled.frames is not None
    one, path = settled.bodies[body], settled.frames.bodies[body]
    start = one.surface.vertices - one.displacement
    points = np.asarray(start @ path.rotation[frame].T + path.translation[frame])
    points[path.moved] += path.offset[frame]
    return points
