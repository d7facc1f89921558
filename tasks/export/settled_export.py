"""The exported scene: the object as a free rigid body, the settled scene as fixed bodies.

In: the segmented scene and object, the anchor, the materials, the simulated bodies and the settled state. Out: an
`ExportScene`, the same for the same values.

The scene as exported fixed bodies: near the object its settled surface, farther away convex pieces.

Near the object, in a box around it, only the simulated bodies of the drop collide: each surface as triangles and prisms
under them, dents included. Everything else is kept out of that box: closed things in reach are decomposed, open
surfaces (scans) and walls, floor and ceiling become prisms behind their faces, because a hull would fill them; farther
things are one hull per part.

The object as an exported rigid body: its frame, its visible mesh, its convex pieces and its inertia at rest.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from dcap.arrays import Array
from dcap.geometry.distance import MeshDistance
from dcap.geometry.pieces import is_closed
from dcap.geometry.raycast import Raycaster
from dcap.geometry.solid.contact_pieces import with_room
from dcap.geometry.solid.convex_pieces import around_vertices, convex_pieces, outside, slab_hull, without_box
from dcap.geometry.solid.surface_prisms import prisms, samples, thinned
from dcap.scene.types.choices import Anchor
from dcap.scene.types.export_scene import (
    ContactPatch,
    ConvexPiece,
    ExportScene,
    FixedBody,
    FreeBody,
    PieceFriction,
    SeenPart,
    replace_friction,
)
from dcap.scene.types.materials import ContactFriction, Material, PartMaterials
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.particles import InertialProperties, Particles, SimulationBody, SoftSimulationBody
from dcap.scene.types.segmentation import Instance, Segmentation
from dcap.scene.types.settled import Settled, SettledBody
from tasks.bodies.discretization import inertial_of_points
from tasks.render.settled_meshes import settled_item, settled_scene

OBJECT = "object"
NEIGHBOURS = 8  # surface points whose displacements, weighted by inverse squared distance, move a point inside
LEAST_DISTANCE = 1e-6  # least distance of a point from its neighbours in such weights [m]
MARGIN, LEAST_MARGIN, MOST_MARGIN = 0.3, 0.03, 0.1
"""Margin of the box around the object on each side: over its larger side [-], and its least and largest value [m]."""
ROOM = 0.01
"""Distance that things outside the simulation keep from the object's box [m], as they did not obstruct the drop."""
REACH = 0.5
"""Distance to the object within which things are decomposed [m]."""
COARSE, COARSE_BUDGETS, COARSE_DEPTH = 0.01, (1000, 300, 100), 0.05
"""For walls and floors: tolerance [m], face budgets, depth of their prisms [m]."""
SHELL, SHELL_BUDGETS = 0.005, (1000, 500, 250)
"""For open surfaces in reach, most of them scanned: tolerance [m], face budgets."""
UNASSIGNED = "unassigned"
TOUCHING = 0.02
"""Distance between boxes at rest within which shapes get the friction of their pair, if it differs from the piece's
main friction [m]."""


@dataclass(frozen=True, eq=False, slots=True)
class BodyFrame:
    """The frame of a body in the world."""

    rotation: Array
    """Rotation matrix, shape (3, 3)."""
    position: Array
    """Position of the origin [m], shape (3,)."""

    @property
    def quaternion(self) -> Array:
        """Quaternion (w, x, y, z) with w >= 0, shape (4,)."""
        return np.asarray(Rotation.from_matrix(self.rotation).as_quat(canonical=True, scalar_first=True))

    def inside(self, mesh: Mesh) -> Mesh:
        """A mesh of the world in the body's frame."""
        return Mesh((mesh.vertices - self.position) @ self.rotation, mesh.faces, mesh.colors)


def free_body(
    item: Segmentation, anchor: Anchor, materials: PartMaterials | None, body: SettledBody, start: SimulationBody,
    touched: Array,
) -> FreeBody:  # fmt: skip
    """The object at rest; `start`: its body before the drop, `touched`: points that it may touch (n, 3) [m]."""
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

    For a soft body, the mass properties of its material points, each moved with the surface around it: their
    displacements beyond the rigid motion, weighted by inverse squared distance.
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
    """The friction of each piece: that with the largest area on its surface."""
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
    """The material of each part of a body, by the part's index, where it has one."""
    rows = materials.rows if materials else ()
    return {row.part_index: row.material for row in rows if row.body == body}


def unique(names: list[str]) -> list[str]:
    """The names, with numbers appended to repeated names."""
    used: dict[str, int] = {}
    result = []
    for name in names:
        used[name] = used.get(name, 0) + 1
        result.append(name if used[name] == 1 else f"{name}.{used[name]}")
    return result


class NearBox:
    """The box around the object in which its settled contact is exact."""

    def __init__(self, settled: Settled) -> None:
        self.thing = settled.bodies[0].surface
        self.object = self.thing.bounds
        size = float(np.ptp(self.object, axis=0).max())
        margin = float(np.clip(MARGIN * size, LEAST_MARGIN, MOST_MARGIN))
        self.low, self.high = self.object + np.array([[-margin], [margin]])
        others = [one.surface.bounds for one in settled.bodies[1:] if len(one.surface.faces)]
        if others:  # no farther than the simulated surfaces extend in plan
            low, high = np.min([one[0] for one in others], axis=0), np.max([one[1] for one in others], axis=0)
            self.low[:2] = np.minimum(np.maximum(self.low, low), self.object[0] - ROOM)[:2]
            self.high[:2] = np.maximum(np.minimum(self.high, high), self.object[1] + ROOM)[:2]

    def faces(self, mesh: Mesh) -> NDArray[np.int64]:
        """Faces of a mesh that reach into the box."""
        corner = mesh.triangles
        return np.flatnonzero(((corner.max(axis=1) >= self.low) & (corner.min(axis=1) <= self.high)).all(axis=1))

    def reaches(self, mesh: Mesh) -> bool:
        """Return whether a part of a mesh is near enough to be decomposed."""
        corner = mesh.triangles
        low, high = self.object + np.array([[-REACH], [REACH]])
        return bool(((corner.max(axis=1) >= low) & (corner.min(axis=1) <= high)).all(axis=1).any())


def fixed_bodies(
    scene: Segmentation, settled: Settled, particles: Particles, materials: PartMaterials | None
) -> tuple[list[FixedBody], float]:
    """All things of the settled scene, and the largest distance of the patches from the settled surfaces [m]."""
    near = NearBox(settled)
    simulated: dict[str, list[tuple[SettledBody, SimulationBody]]] = {}
    for body, start in zip(settled.bodies[1:], particles.bodies[1:], strict=True):
        simulated.setdefault(start.instance, []).append((body, start))
    overrides = {frozenset(row[:2]): row[2:] for row in particles.friction_pairs}
    mine = particles.bodies[0]
    main = particles.bodies[1].friction if len(particles.bodies) > 1 else mine.friction
    result, deviation = [], 0.0
    for index, one in enumerate(scene.instances):
        faces = np.flatnonzero(scene.face_instance == index)
        if not len(faces):
            continue
        known = constants(materials, one.id)
        patches: list[ContactPatch] = []
        for body, start in simulated.get(one.id, []):
            own = overrides.get(frozenset((mine.name, start.name)))
            found, off = patches_of(body, start, near, mine.friction, own)
            patches += found
            deviation = max(deviation, off)
        friction = next(iter(known.values())).friction if known else main
        pieces = far_pieces(scene, index, near, simulated=one.id in simulated)
        pair = pair_friction(mine.friction, friction)
        named = tuple(ConvexPiece(f"{one.id}/piece_{k:03d}", piece, pair) for k, piece in enumerate(pieces))
        result.append(FixedBody(one.id, one.label, seen_parts(scene, index, one, materials), tuple(patches), named))
    rest = np.flatnonzero(scene.face_instance < 0)
    if len(rest):
        part = SeenPart(UNASSIGNED, scene.mesh.submesh(rest), None)
        result.append(FixedBody(UNASSIGNED, "", (part,), (), ()))
    return result, deviation


def seen_parts(scene: Segmentation, index: int, one: Instance, materials: PartMaterials | None) -> tuple[SeenPart, ...]:
    """Visible meshes of a thing, part by part."""
    mine, known = scene.face_instance == index, constants(materials, one.id)
    names = unique([part.name for part in one.parts])
    found = []
    for number, name in [*enumerate(names), (-1, UNASSIGNED)]:
        faces = np.flatnonzero(mine & (scene.face_part == number))
        if len(faces):
            found.append(SeenPart(name, scene.mesh.submesh(faces), known.get(number)))
    return tuple(found)


def patches_of(
    body: SettledBody,
    start: SimulationBody,
    near: NearBox,
    object_friction: ContactFriction,
    own: tuple[float, float] | None,
) -> tuple[list[ContactPatch], float]:
    """The settled surface of a body near the object, one patch per friction, and its deviation [m]."""
    faces = near.faces(body.surface)
    if not len(faces):
        return [], 0.0
    given = body.surface.submesh(faces)
    few = thinned(given)
    deep = prisms(few.mesh, body.surface, free=near.thing)
    kinds, kind = frictions_of_faces(given, faces, few.mesh, start)
    patches = []
    for index, friction in enumerate(kinds):
        mine = np.flatnonzero(kind == index)
        if not len(mine):
            continue
        pair = pair_friction(object_friction, friction)
        if own is not None:
            pair = ContactFriction(own[0], own[1], pair.rolling_resistance)
        solid = [deep[face] for face in mine]
        name = f"{body.name}/contact" + (f"_{index}" if len(kinds) > 1 else "")
        patches.append(ContactPatch(name, few.mesh.submesh(mine), tuple(one for one in solid if one is not None), pair))
    return patches, few.deviation


def frictions_of_faces(
    given: Mesh, faces: NDArray[np.int64], few: Mesh, start: SimulationBody
) -> tuple[list[ContactFriction], NDArray[np.int64]]:
    """The kinds of friction of a body's faces near the object, and the kind of each face of its simplified surface:
    that of the nearest original face."""
    if start.face_friction is None:
        return [start.friction], np.zeros(len(few.faces), dtype=np.int64)
    kinds, kind = np.unique(start.face_friction[faces], axis=0, return_inverse=True)
    nearest = MeshDistance(given).nearest_face(few.triangles.mean(axis=1))
    return [ContactFriction(*(float(number) for number in row)) for row in kinds], kind.reshape(-1)[nearest]


def pair_friction(a: ContactFriction, b: ContactFriction) -> ContactFriction:
    """The friction of a pair: the geometric mean of the two, as in the drop."""
    return ContactFriction(
        float(np.sqrt(a.static * b.static)),
        float(np.sqrt(a.dynamic * b.dynamic)),
        float(np.sqrt(a.rolling_resistance * b.rolling_resistance)),
    )


def far_pieces(scene: Segmentation, index: int, near: NearBox, *, simulated: bool) -> list[Mesh]:
    """Convex pieces of a thing outside the box around the object."""
    one, mesh = scene.instances[index], scene.instance_mesh(index)
    if one.structure:
        flat = thinned(mesh, COARSE, COARSE_BUDGETS).mesh
        found = [piece for piece in prisms(flat, mesh, COARSE_DEPTH) if piece is not None]
    elif near.reaches(mesh) and is_closed(mesh):
        found = convex_pieces(mesh)
    elif near.reaches(mesh):
        found = [piece for piece in prisms(thinned(mesh, SHELL, SHELL_BUDGETS).mesh, mesh) if piece is not None]
    else:
        mine = scene.face_instance == index
        parts = [np.flatnonzero(mine & (scene.face_part == part)) for part in range(-1, len(one.parts))]
        hulls = [slab_hull(scene.mesh.submesh(faces)) for faces in parts if len(faces)]
        found = [hull for hull in hulls if hull is not None]
    if one.structure and not simulated:
        low, high = near.object + np.array([[-ROOM], [ROOM]])
    else:
        low, high = near.low, near.high
    return [piece for whole in found for piece in without_box(whole, low, high)]


def export_scene(
    scene: Segmentation,
    item: Segmentation,
    anchor: Anchor,
    materials: PartMaterials | None,
    particles: Particles,
    settled: Settled,
) -> ExportScene:
    """The exported scene of a placement at rest."""
    after = settled_scene(scene, settled, anchor.base_id).scene
    fixed, deviation = fixed_bodies(after, settled, particles, materials)
    near = NearBox(settled)
    touched = [samples(one.surface.submesh(near.faces(one.surface))) for one in settled.bodies[1:]]
    points = np.concatenate([*touched, np.zeros((0, 3))])
    thing = free_body(item, anchor, materials, settled.bodies[0], particles.bodies[0], points)
    simulated = "; it was simulated as a soft body" if thing.soft else ""
    notes = (
        f"the object ({thing.label}) is a rigid body in the shape in which it settled{simulated}",
        f"it collides as {len(thing.pieces)} convex pieces; away from its contact they may fill hollows slightly",
        f"near the object the fixed scene collides as its settled surface, within {1e3 * deviation:.3f} mm",
        "things out of reach of the object collide as one convex hull per part",
    )
    resting = resting_friction(fixed, settled.contact_points, thing.friction)
    return ExportScene(thing, tuple(fixed), pairs_of(thing, fixed), resting, deviation, notes)


def resting_friction(fixed: list[FixedBody], contact: NDArray[np.float64], alone: ContactFriction) -> ContactFriction:
    """The friction of the pair on the patch that is nearest to most contact points (k, 3); `alone` if there is no
    patch."""
    patches = [patch for one in fixed for patch in one.patches]
    if not patches or not len(contact):
        return patches[0].friction if patches else alone
    away = np.stack([Raycaster(patch.surface).distance_to(contact) for patch in patches])
    nearest: ContactPatch = patches[int(np.bincount(away.argmin(axis=0)).argmax())]
    return nearest.friction


def pairs_of(thing: FreeBody, fixed: list[FixedBody]) -> tuple[PieceFriction, ...]:
    """Pairs of nearby shapes whose friction differs from the fixed shape's: pieces of other parts."""
    turn = Rotation.from_quat(thing.quaternion, scalar_first=True).as_matrix()
    found = []
    for piece in thing.pieces:
        if piece.friction == thing.friction:
            continue
        points = piece.mesh.vertices @ turn.T + thing.position
        low, high = points.min(axis=0) - TOUCHING, points.max(axis=0) + TOUCHING
        for patch in (patch for one in fixed for patch in one.patches):
            friction = replace_friction(patch.friction, thing.friction, piece.friction)
            bounds = np.array([prism.bounds for prism in patch.prisms]).reshape(-1, 2, 3)
            near = ((bounds[:, 0] <= high) & (bounds[:, 1] >= low)).all(axis=1)
            found += [PieceFriction(piece.name, patch.name, int(k), friction) for k in np.flatnonzero(near)]
    return tuple(found)
