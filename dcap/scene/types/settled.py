"""What the drop returns: the state at rest and its certificate, or the last state and why it is not one."""

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
        """Where its start pose went, as a whole, shape (4, 4)."""
        pose = np.eye(4)
        pose[:3, :3] = Rotation.from_quat(self.quaternion, scalar_first=True).as_matrix()
        pose[:3, 3] = self.position
        return pose


@dataclass(frozen=True, slots=True)
class LeanCheck:
    """How the object leans: what was asked and what came out."""

    on: str
    """Instance id, or 'part:NAME' of the base, that it was to lean on."""
    asked_rad: float
    """Tilt of its upright axis from the vertical at the start [rad]."""
    rest_rad: float
    """The same at rest [rad]."""
    change_rad: CertificateRow
    """The difference of the two."""
    held_share: CertificateRow
    """Normal force between the object and what it leans on over all that acts on it; of a part of the base the share
    of the contact's points above the object's foot [-]."""


@dataclass(frozen=True, slots=True)
class PoseCheck:
    """A pose or a facing that was asked for, and what came out."""

    asked: str
    """upright, on_back ...; `facing ID`; `turned by N degrees`."""
    found: str
    """What the rest state shows, in the same words; of a facing the angle that it is off."""
    angle_rad: float
    """Angle between what was asked and what was found [rad]."""
    threshold_rad: float
    """Largest angle that meets it [rad]."""
    met: bool
    doubt: str = ""
    """Why the shape does not tell whether it is met; empty: it does."""


@dataclass(frozen=True, slots=True)
class PlacementChecks:
    """What was asked of the rest state."""

    carried_share: CertificateRow
    """Share of the object's weight that the base carries [-]."""
    tilt_rad: CertificateRow | None = None
    """Change of the object's tilt, where an orientation was asked."""
    turn_rad: CertificateRow | None = None
    """Turn about the vertical, where a facing was asked."""
    lean: LeanCheck | None = None
    """How it leans, where that was asked."""
    column: tuple[ColumnLayer, ...] | None = None
    """What of a soft base lies under the predicted contact, from the top down."""
    foreseen_share: CertificateRow | None = None
    """Share of the contact's points that lie where it was foreseen, and cells were made for it [-]; None unless most of
    what presses on the object is soft, and where it leans."""
    poses: tuple[PoseCheck, ...] = ()
    """Every pose and facing that was asked, in the words of the request."""
    indentation_m: float = 0.0
    """Largest way down of the base's surface since the drop began [m]: how deep the dent is; 0 on a rigid base."""


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
    """None where nothing was simulated: the pose is a claim."""
    history: History
    steps: int
    simulated_seconds: float
    warnings: tuple[str, ...]
    checks: PlacementChecks | None = None
    """None before the rest state is compared with what was asked."""
    frames: DropFrames | None = None
    """How the bodies came there, in their order; None where nobody kept it."""
    material: tuple[MaterialState | None, ...] = ()
    """Of each body, None of rigid ones; empty where the method does not say."""
    nodes: tuple[NDArray[np.float32] | None, ...] = ()
    """Displacement of the nodes of each body's grid [m], shape (n, 3), None of rigid ones; empty as `material`."""


@dataclass(frozen=True, eq=False, slots=True)
class LastState:
    """What an infeasible drop keeps of the state in which it ended."""

    certificate: Certificate
    contacts: tuple[ContactRow, ...]
    position: NDArray[np.float64]
    """Of the object, as in SettledBody [m], shape (3,)."""
    quaternion: NDArray[np.float64]
    """Of the object, as in SettledBody, shape (4,)."""
    steps: int
    simulated_s: float
    warnings: tuple[str, ...]
    checks: PlacementChecks


@dataclass(frozen=True, slots=True)
class EndPose:
    """Where the object was when a drop ended, as in SettledBody: a second drop makes its cells fine there."""

    position: tuple[float, float, float]
    """[m]."""
    quaternion: tuple[float, float, float, float]


@dataclass(frozen=True, slots=True)
class SettledMaterial:
    """What became of one soft body."""

    body: str
    points: int
    """Material points."""
    volume_before_m3: float
    """Of the material before the drop."""
    volume_m3: float
    """At rest."""
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
