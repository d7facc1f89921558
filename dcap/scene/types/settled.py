"""Result of the drop: the state at rest and its certificate, or the last state and the reason why it is not at rest."""

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
    """Translation of world_from_start, the displacement of the start pose's origin [m], shape (3,)."""
    quaternion: NDArray[np.float64]
    """Rotation of world_from_start as a quaternion (w, x, y, z), best fit for soft bodies, shape (4,)."""
    displacement: NDArray[np.float64]
    """Surface displacement from the start [m], shape (n, 3)."""

    @property
    def world_from_start(self) -> NDArray[np.float64]:
        """Rigid motion of the start pose, shape (4, 4)."""
        pose = np.eye(4)
        pose[:3, :3] = Rotation.from_quat(self.quaternion, scalar_first=True).as_matrix()
        pose[:3, 3] = self.position
        return pose

    def is_rigid(self, tolerance: float) -> bool:
        """Return whether the surface did not deform by more than a tolerance [m]."""
        pose = self.world_from_start
        moved = (self.surface.vertices - self.displacement) @ pose[:3, :3].T + pose[:3, 3]
        return bool(np.abs(moved - self.surface.vertices).max(initial=0.0) <= tolerance)


@dataclass(frozen=True, slots=True)
class LeanCheck:
    """Leaning of the object: request and result."""

    on: str
    """Instance id, or 'part:NAME' of the base, on which the object should lean."""
    asked_rad: float
    """Tilt of the object's upright axis from the vertical at the start [rad]."""
    rest_rad: float
    """Tilt of the object's upright axis from the vertical at rest [rad]."""
    change_rad: CertificateRow
    """The difference between the two tilts."""
    held_share: CertificateRow
    """Normal force between the object and the thing that it leans on over the total normal force on it; for a part of
    the base the share of the contact points above the object's foot [-]."""


@dataclass(frozen=True, slots=True)
class PoseCheck:
    """A requested pose or facing, and the result."""

    asked: str
    """Request: upright, on_back ...; `facing ID`; `turned by N degrees`."""
    found: str
    """Pose at rest, in the same words; for a facing its angular error."""
    angle_rad: float
    """Angle between the requested and the actual direction [rad]."""
    threshold_rad: float
    """Largest angle that meets the request [rad]."""
    met: bool
    doubt: str = ""
    """Reason why the shape does not determine whether the request is met; empty: it does."""


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
    """Share of the contact points inside the predicted patch, where cells are fine [-]; None for a leaning object, and
    if soft bodies exert less than most of the force on the object."""
    poses: tuple[PoseCheck, ...] = ()
    """Every requested pose and facing, in the words of the request."""
    indentation_m: float = 0.0
    """Largest downward displacement of the base's surface since the start [m]: the depth of the dent; 0 on a rigid
    base."""


@dataclass(frozen=True, eq=False, slots=True)
class Settled:
    """The result of the drop."""

    verdict: Verdict
    bodies: tuple[SettledBody, ...]
    """All bodies; the object is first."""
    contacts: tuple[ContactRow, ...]
    """Contacts, one per touching pair."""
    contact_points: NDArray[np.float64]
    """Points of the object's contact patch [m], shape (k, 3)."""
    certificate: Certificate | None
    """Certificate; None if nothing was simulated because the pose is only a proposal."""
    history: History
    steps: int
    simulated_seconds: float
    warnings: tuple[str, ...]
    checks: PlacementChecks | None = None
    """Checks; None before the rest state is compared with the request."""
    frames: DropFrames | None = None
    """Frames of the bodies' motion, in their order; None if they were not kept."""
    material: tuple[MaterialState | None, ...] = ()
    """Material of each body, None for a rigid body; empty if the method does not return it."""
    nodes: tuple[NDArray[np.float32] | None, ...] = ()
    """Displacements of the nodes of each body's grid [m], shape (n, 3), None for a rigid body; empty like
    `material`."""


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
    """Pose of the object at the end of a drop, as in SettledBody, around which a second drop has fine cells."""

    position: tuple[float, float, float]
    """Position [m]."""
    quaternion: tuple[float, float, float, float]


@dataclass(frozen=True, slots=True)
class SettledMaterial:
    """Final state of one soft body."""

    body: str
    points: int
    """Number of material points."""
    volume_before_m3: float
    """Volume of the material before the drop."""
    volume_m3: float
    """Volume of the material at rest."""
    largest_displacement_m: float
    largest_stress_pa: float
    """Largest von Mises stress."""
    surface_to_points_mean_m: float
    """Mean distance of the settled surface's vertices from the nearest material point."""
    surface_to_points_max_m: float


def surface_at(settled: Settled, body: int, frame: int) -> NDArray[np.float64]:
    """Surface points of a body at a frame [m], shape (n, 3)."""
    assert settled.frames is not None
    one, path = settled.bodies[body], settled.frames.bodies[body]
    start = one.surface.vertices - one.displacement
    points = np.asarray(start @ path.rotation[frame].T + path.translation[frame])
    points[path.moved] += path.offset[frame]
    return points
