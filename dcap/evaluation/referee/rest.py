"""Judges a rest state: its motion in one second of MuJoCo, and its overlap by Open3D's distances.

In: the final triangles of an object and of the scene around it (world frame, z up, metres), the object's mass and the
friction of each pair. Out: a `RestVerdict`. Everything is rigid, dents included, and the same for every method. Neither
the solver nor the contact model of the drop takes part.

`judge_rest` may be called with plain arrays:

    scene = Surroundings.of([Mesh.of(vertices, faces), ...], friction=[0.5, ...])
    verdict = judge_rest(Mesh.of(vertices, faces), scene, mass=1.2)

Depth of the overlap between an object and a scene, only by Open3D's signed distances.

In: both surfaces. Out: the largest distance of a point of one inside the other from the other's surface: of the scene
inside the object, and of the object inside each closed piece of the scene. A scan, which is open, has no inside: there
only the scene's points in the object count.

One second of a rigid body in MuJoCo, among shapes that do not move.

Contacts are stiff and overdamped: a landing body stops within a step and does not bounce; an initial overlap decays
with the time constant of a twentieth of a second, without throwing the body; a resting body sinks in by 0.01 mm.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dcap.arrays import Array
from dcap.evaluation.referee.prisms import Prisms, object_prisms, scene_prisms, within
from dcap.geometry.pieces import numbered_pieces
from dcap.geometry.raycast import tensor
from dcap.geometry.solid.repair import mass_properties, subdivide_near
from dcap.scene.errors import GeometryError, InputError
from dcap.scene.types.arrays import check_array
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.particles import GRAVITY, InertialProperties

FINE, LEAST_EDGE = 1.0 / 64.0, 1e-3
"""Longest edge of the faces that are sampled over the object's size [-], and at least [m]."""
VOTES = 11
"""Number of rays whose majority decides whether a point is inside: one may graze an edge."""
MISSING = "the referee needs MuJoCo: pip install dcap[referee]"
STEP, QUIET_STEP, QUIET = 5e-4, 2e-3, 5e-3
"""Time steps [s]: after a fall of a centimetre a body moves 0.2 mm in a step; the long step is for a body in contact
that is everywhere slower than QUIET [m/s], which moves 0.01 mm in one."""
APART = 0.05
"""Time constant with which an overlap decays [s]."""
SOLIMP = (0.99, 0.99, 1e-3, 0.5, 2.0)
"""Impedance d [-], the same at all depths: at rest a contact is g (1 - d) / d (timeconst * dampratio * d)^2 deep,
9.7e-6 m with long steps."""
IMPRATIO = 10.0
"""Stiffness of friction over that of the normal contact [-]: it creeps by micrometres in a second."""
TORSION = 1e-3
"""Torsional friction [m], as of a contact of points a millimetre apart."""
LEAST_FRICTION = 1e-5
"""Least coefficient that MuJoCo accepts."""
SLIDING, ROLLING = 3, 6
"""Dimensions of a contact without and with resistance to rolling."""
MEMORY = 1 << 29
"""Memory for contacts [bytes]."""
LAST = 0.1
"""Final share of the time over which the carrying forces are averaged [-]."""
SECONDS = 1.0
"""Simulated time [s]."""


def overlap_depth(thing: Mesh, scene: Mesh, owner: NDArray[np.int64]) -> float:
    """Depth of their overlap [m], 0 without one."""
    box = thing.bounds
    edge = max(FINE * float(np.ptp(box, axis=0).max()), LEAST_EDGE)
    met = within(scene.triangles, box[0], box[1])
    depth = depth_in(thing, samples(scene.submesh(np.flatnonzero(met)), box, edge)) if met.any() else 0.0
    points = samples(thing, box, edge)
    for index in np.unique(owner):  # a solid may hold all of the object without a face near it
        whole = scene.submesh(np.flatnonzero(owner == index))
        if within(whole.bounds[None], box[0], box[1]).any():
            depth = max([depth, *(depth_in(piece, points) for piece in closed_pieces(whole))])
    return depth


def samples(mesh: Mesh, box: Array, edge: float) -> Array:
    """Corners and middles of the faces, those in a box cut to edges of at most `edge` [m], shape (n, 3)."""
    fine = subdivide_near(mesh, box, edge)
    return np.concatenate([fine.vertices, fine.triangles.mean(axis=1)])


def depth_in(solid: Mesh, points: Array) -> float:
    """Largest depth of points (n, 3) inside a surface [m], 0 if none is inside."""
    import open3d

    low, high = solid.bounds
    points = points[((points > low) & (points < high)).all(axis=1)]
    if not len(points):
        return 0.0
    middle = solid.bounds.mean(axis=0)  # Open3D computes in single precision
    scene = open3d.t.geometry.RaycastingScene()
    scene.add_triangles(tensor(solid.vertices - middle), tensor(solid.faces, np.uint32))
    signed = scene.compute_signed_distance(tensor(points - middle), nsamples=VOTES).numpy()
    return float(max(0.0, -signed.min()))


def closed_pieces(mesh: Mesh) -> list[Mesh]:
    """The closed connected pieces of a surface."""
    piece, is_open = numbered_pieces(mesh)
    return [mesh.submesh(np.flatnonzero(piece == one)) for one in np.flatnonzero(~is_open)]


@dataclass(frozen=True, eq=False, slots=True)
class Motion:
    """Motion of the body."""

    drift_m: float
    """Largest distance of the centre of mass from its start [m]."""
    drift_deg: float
    """Largest turn from the start [degrees]."""
    carried: Array
    """Upward force of each thing over the weight at the end [-], shape (k,)."""


def simulate(fixed: Prisms, friction: Array, free: Prisms, inertial: InertialProperties, seconds: float) -> Motion:
    """Simulate a body from rest.

    Args:
        fixed: the shapes of the scene.
        friction: between the body and each thing: sliding [-] and rolling resistance [m], shape (k, 2).
        free: the shapes of the body.
        inertial: in the world.
        seconds: how long [s].

    Raises InputError without MuJoCo, GeometryError where it cannot simulate the shapes.
    """
    try:
        import mujoco  # an extra
    except ImportError:
        raise InputError(MISSING) from None
    mujoco.set_mju_user_warning(lambda text: None)  # else a file in the working folder; counted below
    try:
        model = spec_of(fixed, friction, free, inertial).compile()
    except ValueError as error:
        raise GeometryError(f"MuJoCo cannot simulate these shapes: {' '.join(str(error).split())}") from None
    data = mujoco.MjData(model)
    owner = np.concatenate([np.maximum(fixed.owner, 0), np.full(len(free.corners), -1)])
    start, turned = data.qpos[:3].copy(), data.qpos[3:7].copy()
    size = float(np.linalg.norm(free.corners - inertial.center_of_mass, axis=2).max())
    drift, cosine = 0.0, 1.0
    carried, looks = np.zeros(len(friction)), 0
    while data.time < seconds - 0.5 * STEP:
        speed = float(np.linalg.norm(data.qvel[:3]) + size * np.linalg.norm(data.qvel[3:]))
        quiet = data.ncon > 0 and speed < QUIET
        set_step(model, min(QUIET_STEP if quiet else STEP, seconds - data.time))
        mujoco.mj_step(model, data)
        drift = max(drift, float(np.linalg.norm(data.qpos[:3] - start)))
        cosine = min(cosine, abs(float(data.qpos[3:7] @ turned)))
        if data.time >= (1.0 - LAST) * seconds:
            add_forces(model, data, owner, carried)
            looks += 1
    if not np.isfinite(data.qpos).all() or any(one.number for one in data.warning):
        first = next((str(mujoco.mjtWarning(k)) for k, one in enumerate(data.warning) if one.number), "not finite")
        raise GeometryError(f"MuJoCo's simulation broke: {first}")
    turn = float(np.degrees(2.0 * np.arccos(min(cosine, 1.0))))
    return Motion(drift, turn, carried / (looks * inertial.mass * GRAVITY))


def set_step(model: Any, step: float) -> None:
    """Set the time step [s], and contacts as stiff as it allows: with the least time constant that MuJoCo takes, two
    steps, and the damping ratio at which overlap decays at the same rate, APART = 2 timeconst dampratio^2."""
    model.opt.timestep = step
    model.geom_solref[:] = 2.0 * step, np.sqrt(0.25 * APART / step)


def spec_of(fixed: Prisms, friction: Array, free: Prisms, inertial: InertialProperties) -> Any:
    """The model, an `mujoco.MjSpec`; the body's frame is at its centre of mass."""
    import mujoco

    spec = mujoco.MjSpec()
    spec.memory = MEMORY
    option = spec.option
    option.gravity = (0.0, 0.0, -GRAVITY)
    option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    option.cone, option.impratio = mujoco.mjtCone.mjCONE_ELLIPTIC, IMPRATIO
    option.solver, option.tolerance = mujoco.mjtSolver.mjSOL_NEWTON, 1e-10
    body = spec.worldbody.add_body(name="object", pos=inertial.center_of_mass)
    body.add_freejoint()
    body.explicitinertial, body.mass, body.ipos = True, inertial.mass, np.zeros(3)
    body.fullinertia = inertial.inertia[[0, 1, 2, 0, 0, 1], [0, 1, 2, 1, 2, 2]]
    for number, (corners, index) in enumerate(zip(fixed.corners, fixed.owner, strict=True)):
        sliding, rolling = np.maximum(friction[index], LEAST_FRICTION)
        shape = add_shape(spec, spec.worldbody, f"fixed_{number}", corners)
        shape.friction, shape.priority, shape.contype, shape.conaffinity = (sliding, TORSION, rolling), 1, 1, 0
        shape.condim = ROLLING if rolling > LEAST_FRICTION else SLIDING
    for number, corners in enumerate(free.corners):  # the scene's friction, which is for the pair, has priority
        shape = add_shape(spec, body, f"free_{number}", corners - inertial.center_of_mass)
        shape.contype, shape.conaffinity = 0, 1
    return spec


def add_shape(spec: Any, body: Any, name: str, corners: Array) -> Any:
    """Add a convex shape with corners (n, 3) [m] in a body's frame. MuJoCo stores them in single precision, which is
    exact enough relative to their middle."""
    import mujoco

    middle = corners.mean(axis=0)
    mesh = spec.add_mesh(name=name, uservert=(corners - middle).ravel())
    mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL  # a sliver has an area
    return body.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name, pos=middle, condim=SLIDING, solimp=SOLIMP)


def add_forces(model: Any, data: Any, owner: NDArray[np.int64], carried: Array) -> None:
    """Add the upward force [N] on the body to that of the thing of each contact (k,)."""
    import mujoco

    force = np.zeros(6)
    for index in range(data.ncon):
        contact = data.contact[index]
        mujoco.mj_contactForce(model, data, index, force)
        up = float(force[:3] @ contact.frame.reshape(3, 3)[:, 2])  # on the second shape
        first, second = owner[contact.geom[0]], owner[contact.geom[1]]
        carried[max(first, second)] += up if second < 0 else -up


@dataclass(frozen=True, eq=False, slots=True)
class Surroundings:
    """The scene that an object rests in, in its final state."""

    mesh: Mesh
    """All of it, wound outwards."""
    owner: NDArray[np.int64]
    """Thing of each face, an index of `friction`, shape (m,)."""
    friction: Array
    """Friction between the object and each thing: sliding [-] and rolling resistance [m], shape (k, 2)."""

    def __post_init__(self) -> None:
        check_array("owner of the surroundings", self.owner, len(self.mesh.faces))
        check_array("friction of the surroundings", self.friction, None, 2)
        if len(self.owner) and not 0 <= self.owner.min() <= self.owner.max() < len(self.friction):
            raise InputError(f"owners {self.owner.min()}..{self.owner.max()} outside 0..{len(self.friction) - 1}")

    @classmethod
    def of(cls, things: Sequence[Mesh], friction: float | Sequence[float]) -> "Surroundings":
        """The surroundings of one mesh for each thing, with the sliding friction of all pairs or of each [-]."""
        sliding = np.broadcast_to(np.asarray(friction, dtype=np.float64), len(things))
        owner = np.repeat(np.arange(len(things)), [len(one.faces) for one in things])
        return cls(Mesh.concatenate(list(things)), owner, np.column_stack([sliding, np.zeros(len(things))]))


@dataclass(frozen=True, eq=False, slots=True)
class RestVerdict:
    """The referee's verdict on a rest state."""

    seconds: float
    """Simulated time [s]."""
    drift_m: float
    """Largest distance of the centre of mass from its start [m]."""
    drift_deg: float
    """Largest turn from the start [degrees]."""
    carried: Array
    """Share of the weight that each thing carries in the last tenth of the second [-], shape (k,); negative if it
    presses from above."""
    penetration_m: float
    """Overlap of object and scene at the start, by Open3D's distances [m]."""
    deviation_m: float
    """Largest distance of the collision shapes from the surfaces near the contact [m]."""

    @property
    def supported(self) -> bool:
        """Whether the scene carries the object at the end; else it falls."""
        return bool(self.carried.sum() >= CARRIED)

    @property
    def carrier(self) -> int:
        """Index of the thing that carries most at the end; -1 if nothing does."""
        return int(self.carried.argmax()) if self.supported else -1


CARRIED = 0.5
"""Least share of the weight that a support carries [-]: halfway between a fall and rest."""


def judge_rest(
    thing: Mesh,
    scene: Surroundings,
    mass: float | None = None,
    center_of_mass: Array | None = None,
    *,
    inertial: InertialProperties | None = None,
    seconds: float = SECONDS,
) -> RestVerdict:
    """Judge a rest state; InputError without MuJoCo, GeometryError where the object encloses nothing.

    Args:
        thing: the object's final surface.
        scene: its surroundings in their final state. Parts out of reach within the time may be missing.
        mass: of the object [kg], of one density.
        center_of_mass: if it is not that of one density [m], shape (3,).
        inertial: mass, centre of mass and inertia about it in the world, if known; instead of the two.
        seconds: simulated time [s].
    """
    if inertial is None:
        if mass is None:
            raise InputError("the referee needs the mass of the object, or its inertia")
        whole, center, inertia = mass_properties(thing, 1.0)
        center = center if center_of_mass is None else np.asarray(center_of_mass, dtype=np.float64)
        inertial = InertialProperties(mass, center, inertia * (mass / whole))
    if not inertial.mass > 0.0:
        raise GeometryError(f"the object's mass is {inertial.mass} kg, expected more than 0")
    fixed, free = scene_prisms(scene.mesh, scene.owner, thing), object_prisms(thing, scene.mesh)
    motion = simulate(fixed, scene.friction, free, inertial, seconds)
    return RestVerdict(
        seconds=seconds,
        drift_m=motion.drift_m,
        drift_deg=motion.drift_deg,
        carried=motion.carried,
        penetration_m=overlap_depth(thing, scene.mesh, scene.owner),
        deviation_m=max(fixed.deviation, free.deviation),
    )
