"""The scene as exported fixed bodies: near the object its settled surface, farther away convex pieces.

Near the object, in a box around it, only what the drop simulated collides: each surface as triangles and prisms under
them, dents and all. Everything else is kept out of that box: closed things in reach are decomposed, open ones (scans)
and walls, floor and ceiling are prisms behind their faces, because a hull would fill them; farther things are one hull
per part.
"""

import numpy as np
from numpy.typing import NDArray

from dcap.geometry.boundary import is_closed
from dcap.geometry.distance import MeshDistance
from dcap.geometry.solid.convex_pieces import convex_pieces, slab_hull, without_box
from dcap.geometry.solid.surface_prisms import prisms, thinned
from dcap.scene.types.export_scene import ContactPatch, ConvexPiece, FixedBody, SeenPart
from dcap.scene.types.materials import ContactFriction, PartMaterials
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.particles import Particles, SimulationBody
from dcap.scene.types.segmentation import Instance, Segmentation
from dcap.scene.types.settled import Settled, SettledBody
from tasks.export.free_body import constants, unique

Array = NDArray[np.float64]

MARGIN, LEAST_MARGIN, MOST_MARGIN = 0.3, 0.03, 0.1
"""Margin of the box around the object on each side: over its larger side [-], and its least and largest value [m]."""
ROOM = 0.01
"""Distance of things that were not simulated from the object's own box [m], as they were not in the drop's way."""
REACH = 0.5
"""Distance to the object within which things are decomposed [m]."""
COARSE, COARSE_BUDGETS, COARSE_DEPTH = 0.01, (1000, 300, 100), 0.05
"""Walls and floors: tolerance [m], faces of each, depth of their prisms [m]."""
SHELL, SHELL_BUDGETS = 0.005, (1000, 500, 250)
"""Open surfaces in reach, most of them scanned: tolerance [m], faces of each, depth of their prisms [m]."""
UNASSIGNED = "unassigned"


class NearBox:
    """The box around the object in which its settled contact is exact."""

    def __init__(self, settled: Settled) -> None:
        self.thing = settled.bodies[0].surface
        self.object = self.thing.bounds
        size = float(np.ptp(self.object, axis=0).max())
        margin = float(np.clip(MARGIN * size, LEAST_MARGIN, MOST_MARGIN))
        self.low, self.high = self.object + np.array([[-margin], [margin]])
        others = [one.surface.bounds for one in settled.bodies[1:] if len(one.surface.faces)]
        if others:  # no farther than the simulated surfaces go, in plan
            low, high = np.min([one[0] for one in others], axis=0), np.max([one[1] for one in others], axis=0)
            self.low[:2] = np.minimum(np.maximum(self.low, low), self.object[0] - ROOM)[:2]
            self.high[:2] = np.maximum(np.minimum(self.high, high), self.object[1] + ROOM)[:2]

    def faces(self, mesh: Mesh) -> NDArray[np.int64]:
        """Faces of a mesh that reach into it."""
        corner = mesh.triangles
        return np.flatnonzero(((corner.max(axis=1) >= self.low) & (corner.min(axis=1) <= self.high)).all(axis=1))

    def reaches(self, mesh: Mesh) -> bool:
        """Whether a part of a mesh is near enough to be decomposed."""
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
    """The kinds of friction of a body's faces near the object, and the kind of each face of its thinned surface: that
    of the face it is nearest to."""
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
    """Convex pieces of a thing where it is not near the object."""
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
