"""One second of a rigid body in MuJoCo, among shapes that do not move.

Contacts are stiff and overdamped: a landing body stops within a step and does not bounce; an initial overlap decays
with the time constant of a twentieth of a second, without throwing the body; a resting body sinks in by 0.01 mm.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dcap.arrays import Array
from dcap.evaluation.referee.prisms import Prisms
from dcap.scene.errors import GeometryError, InputError
from dcap.scene.types.particles import GRAVITY, InertialProperties

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
