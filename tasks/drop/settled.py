"""The solver's result as a type of the pipeline, and its pose compared with the requested one.

In: the solver's result; the requested pose, as directions of the mesh and the world, and the object before and after
the drop. Out: `Settled`; a row of the certificate, and a line for people, for each requested pose, facing and turn.
"""

import numpy as np
from scipy.spatial.transform import Rotation

from dcap.arrays import Array
from dcap.scene.types.choices import AskedPose, OrientationRequest
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.outcome import Cause, Caution
from dcap.scene.types.particles import Particles
from dcap.scene.types.settled import PoseCheck, Settled, SettledBody
from solver.result import SettledModel

ON_END = ("standing", "upright", "leaning")
"""Poses that flat and long things lose by lying down."""
NOT_KNOWN = "the direction that it should face is unknown"
LEVEL = 0.3  # horizontal part of a unit vector below which it looks up or down [-]
UPRIGHT = np.cos(np.pi / 4.0)  # angle to the vertical below which a direction is up or down


def settled_of(particles: Particles, result: SettledModel) -> Settled:
    """The solver's result in the form that the pipeline stores, not yet compared with the request."""
    bodies = []
    for body, rest in zip(particles.bodies, result.bodies, strict=True):
        surface = Mesh(rest.vertices, body.surface.faces, body.surface.colors)
        moved = rest.vertices - body.surface.vertices
        bodies.append(SettledBody(body.name, surface, rest.translation, quaternion(rest.rotation), moved))
    return Settled(
        verdict=result.verdict,
        bodies=tuple(bodies),
        contacts=result.contacts,
        contact_points=result.contact_points[particles.bodies[0].name],
        certificate=result.certificate,
        history=result.history,
        frames=result.frames,
        material=tuple(result.material.get(body.name) for body in particles.bodies) if result.material else (),
        nodes=tuple(result.nodes.get(body.name) for body in particles.bodies) if result.nodes else (),
        steps=result.steps,
        simulated_seconds=result.simulated_seconds,
        warnings=result.warnings + particles.notes,
    )


def quaternion(rotation: Array) -> Array:
    """Quaternion (w, x, y, z) of a rotation matrix, w >= 0."""
    return np.asarray(Rotation.from_matrix(rotation).as_quat(canonical=True, scalar_first=True))


def pose_checks(
    asked: AskedPose | None,
    orientation: OrientationRequest,
    world_from_object: Array,
    quaternion_wxyz: Array,
    turned: float,
    bounds: tuple[float, float],
) -> tuple[PoseCheck, ...]:
    """A row for each requested pose, facing and turn.

    Args:
        asked: the pose as directions of the mesh; None: nothing was requested.
        orientation: the request in words.
        world_from_object: the pose before the drop, shape (4, 4).
        quaternion_wxyz: rotation by the drop.
        turned: its part about the vertical [rad]; the only measure of a facing whose direction is unknown.
        bounds: largest angles that meet a pose and a facing [rad].
    """
    if asked is None:
        return ()
    before = world_from_object[:3, :3] / np.cbrt(np.linalg.det(world_from_object[:3, :3]))
    after = Rotation.from_quat(quaternion_wxyz, scalar_first=True).as_matrix() @ before
    rows = []
    if asked.name != "any":
        rows.append(pose_row(asked, before, after, bounds[0]))
    wishes = [f"facing {orientation.facing}"] if orientation.facing else []
    wishes += [f"turned by {orientation.turn_deg:g} degrees"] if orientation.turn_deg else []
    angle = turned
    if asked.looks is not None and asked.ahead is not None:  # seen from above unless it faces up or down
        looks = after @ asked.looks
        flat = looks * (1.0, 1.0, 0.0)
        length = float(np.linalg.norm(flat))
        way = flat / length if length > LEVEL else looks
        angle = float(np.arccos(np.clip(way @ asked.ahead, -1.0, 1.0)))
    words = f"{np.degrees(angle):.0f} degrees off"
    for wish in wishes:
        unsure = NOT_KNOWN if asked.ahead is None else asked.facing_doubt if wish.startswith("facing") else ""
        rows.append(PoseCheck(wish, words, angle, bounds[1], angle <= bounds[1], unsure))
    return tuple(rows)


def pose_row(asked: AskedPose, before: Array, after: Array, bound: float) -> PoseCheck:
    """The row of the pose itself; rotations before and after the drop, shape (3, 3)."""
    own = angle_from_vertical(after @ asked.axis)
    wanted = asked.from_vertical if asked.from_vertical is not None else angle_from_vertical(before @ asked.axis)
    angle = abs(own - wanted)
    if asked.either_way:
        angle = min(angle, abs(np.pi - own - wanted))
    met = angle <= bound
    found = pose_name(after @ asked.up, after @ asked.front)
    if met and (asked.either_way or (found == "upright" and not asked.doubt)):  # standing, seated; a slab on its back
        found = asked.name
    elif asked.either_way:
        found = "lying" if asked.name in ON_END else "standing"
    return PoseCheck(asked.name, found, angle, bound, met, asked.doubt)


def angle_from_vertical(direction: Array) -> float:
    """Angle of a unit vector from the vertical [rad]."""
    return float(np.arccos(np.clip(direction[2], -1.0, 1.0)))


def pose_name(up: Array, front: Array) -> str:
    """Name of the pose in which a thing's upright axis and front have these directions in the world."""
    if abs(up[2]) > UPRIGHT:
        return "upright" if up[2] > 0.0 else "upside_down"
    left = np.cross(up, front)
    axis = int(np.argmax(np.abs([front[2], left[2]])))
    names = (("on_back", "on_front"), ("on_right_side", "on_left_side"))[axis]
    return names[0] if (front, left)[axis][2] > 0.0 else names[1]


def pose_warnings(rows: tuple[PoseCheck, ...]) -> tuple[str, ...]:
    """A line for each row that is not met or is in doubt."""
    lines = []
    for row in rows:
        what = row.asked.replace("_", " ")
        if not row.met:
            found, angle = row.found.replace("_", " "), np.degrees(row.angle_rad)
            lines.append(
                f"requested {what}, found {found}: {angle:.0f} degrees off; look at the pictures, or try --object-up"
            )
        elif row.doubt:
            lines.append(f"requested {what}: {row.doubt}; look at the pictures, and try --object-up if it is not")
    return tuple(Caution(Cause.NOT_MET, line) for line in lines)
