"""The object as an exported rigid body: its frame, its visible mesh, its convex pieces and its inertia at rest."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from dcap.geometry.solid.contact_pieces import with_room
from dcap.geometry.solid.convex_pieces import around_vertices, convex_pieces, outside
from dcap.scene.types.anchor import Anchor
from dcap.scene.types.export_scene import ConvexPiece, FreeBody, SeenPart
from dcap.scene.types.materials import ContactFriction, Material, PartMaterials
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.particles import InertialProperties, SimulationBody, SoftSimulationBody
from dcap.scene.types.segmentation import Segmentation
from dcap.scene.types.settled import SettledBody
from tasks.bodies.inertial import inertial_of_points
from tasks.render.settled_meshes import settled_item

Array = NDArray[np.float64]

OBJECT = "object"
NEIGHBOURS = 8  # surface points whose displacements, weighted by inverse squared distance, move a point inside
LEAST_DISTANCE = 1e-6  # least distance of a point from its neighbours in such weights [m]


@dataclass(frozen=True, eq=False, slots=True)
class BodyFrame:
    """The frame of a body in the world."""

    rotation: Array
    """Shape (3, 3)."""
    position: Array
    """[m], shape (3,)."""

    @property
    def quaternion(self) -> Array:
        """(w, x, y, z) with w >= 0, shape (4,)."""
        return np.asarray(Rotation.from_matrix(self.rotation).as_quat(canonical=True, scalar_first=True))

    def inside(self, mesh: Mesh) -> Mesh:
        """A mesh of the world in the body's frame."""
        return Mesh((mesh.vertices - self.position) @ self.rotation, mesh.faces, mesh.colors)


def free_body(
    item: Segmentation, anchor: Anchor, materials: PartMaterials | None, body: SettledBody, start: SimulationBody,
    touched: Array,
) -> FreeBody:  # fmt: skip
    """The object at rest; `start` is its body before the drop, `touched` are points that it may touch (n, 3) [m]."""
    pose, parts = settled_pose(anchor, body), item.instances[0]
    thing = settled_item(item, anchor, body)
    faces_of = [np.flatnonzero(item.face_part == index) for index in range(len(parts.parts))]
    known = constants(materials, OBJECT)
    seen = [
        SeenPart(name, pose.inside(thing.submesh(faces)), known.get(index))
        for index, (name, faces) in enumerate(zip(unique([p.name for p in parts.parts]), faces_of, strict=True))
        if len(faces)
    ]
    rest = np.flatnonzero(item.face_part < 0)
    seen += [SeenPart("unassigned", pose.inside(thing.submesh(rest)), None)] if len(rest) else []
    hulls = with_room(around_vertices(convex_pieces(body.surface), body.surface), body.surface, touched)
    frictions = frictions_of(hulls, body.surface, start)
    pieces = tuple(
        ConvexPiece(f"{OBJECT}/piece_{index:02d}", pose.inside(hull), friction)
        for index, (hull, friction) in enumerate(zip(hulls, frictions, strict=True))
    )
    return FreeBody(
        OBJECT, parts.label, pose.position, pose.quaternion, settled_inertial(body, start, pose), start.friction,
        tuple(seen), pieces, isinstance(start, SoftSimulationBody),
    )  # fmt: skip


def settled_pose(anchor: Anchor, body: SettledBody) -> BodyFrame:
    """Pose of the object's own origin and axes, as in placement.json: without the scale."""
    turn = Rotation.from_quat(body.quaternion, scalar_first=True).as_matrix()
    linear = anchor.world_from_object[:3, :3]
    return BodyFrame(
        turn @ linear / np.cbrt(np.linalg.det(linear)), turn @ anchor.world_from_object[:3, 3] + body.position
    )


def settled_inertial(body: SettledBody, start: SimulationBody, pose: BodyFrame) -> InertialProperties:
    """Mass, centre of mass and inertia at rest, in the body's frame.

    For a soft body those of its material points, each moved with the surface around it: their displacements beyond the
    rigid motion, weighted by inverse squared distance.
    """
    turn = Rotation.from_quat(body.quaternion, scalar_first=True).as_matrix()
    own = start.inertial
    if isinstance(start, SoftSimulationBody):
        before = body.surface.vertices - body.displacement
        bent = body.surface.vertices - (before @ turn.T + body.position)
        distance, index = cKDTree(before).query(start.points.position, k=min(NEIGHBOURS, len(before)))
        weight = 1.0 / np.maximum(distance, LEAST_DISTANCE).reshape(len(start.points.position), -1) ** 2
        weight /= weight.sum(axis=1, keepdims=True)
        bend = np.einsum("pk,pki->pi", weight, bent[index.reshape(weight.shape)])
        mass = start.points.volume * start.points.density
        rest = inertial_of_points(start.points.position @ turn.T + body.position + bend, mass)
        own = rest.scaled_to(own.mass)
    else:
        own = InertialProperties(own.mass, turn @ own.center_of_mass + body.position, turn @ own.inertia @ turn.T)
    inertia = pose.rotation.T @ own.inertia @ pose.rotation
    return InertialProperties(
        own.mass, pose.rotation.T @ (own.center_of_mass - pose.position), 0.5 * (inertia + inertia.T)
    )


def frictions_of(hulls: list[Mesh], surface: Mesh, start: SimulationBody) -> list[ContactFriction]:
    """The friction of each piece: the one with the largest area on its surface."""
    if start.face_friction is None:
        return [start.friction] * len(hulls)
    middle, area = surface.triangles.mean(axis=1), surface.face_areas
    owner = np.stack([outside(one, middle) for one in hulls]).argmin(axis=0)
    kinds, kind = np.unique(start.face_friction, axis=0, return_inverse=True)
    share = np.zeros((len(hulls), len(kinds)))
    np.add.at(share, (owner, kind.reshape(-1)), area)
    table = [ContactFriction(*(float(number) for number in row)) for row in kinds]
    return [table[int(row.argmax())] if row.any() else start.friction for row in share]


def constants(materials: PartMaterials | None, body: str) -> dict[int, Material]:
    """The material of each part of a body that has one, by the part's index."""
    rows = materials.rows if materials else ()
    return {row.part_index: row.material for row in rows if row.body == body}


def unique(names: list[str]) -> list[str]:
    """The names, with numbers after repeated ones."""
    used: dict[str, int] = {}
    result = []
    for name in names:
        used[name] = used.get(name, 0) + 1
        result.append(name if used[name] == 1 else f"{name}.{used[name]}")
    return result
