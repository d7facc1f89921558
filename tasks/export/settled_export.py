"""Turns the results of the stages into the exported scene.

In: the segmented scene and object, the anchor, the materials, the simulated bodies and the settled state. Out: an
`ExportScene`, the same for the same values.
"""

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from dcap.geometry.raycast import Raycaster
from dcap.geometry.solid.surface_prisms import samples
from dcap.scene.types.anchor import Anchor
from dcap.scene.types.export_scene import (
    ContactPatch,
    ExportScene,
    FixedBody,
    FreeBody,
    PieceFriction,
    replace_friction,
)
from dcap.scene.types.materials import ContactFriction, PartMaterials
from dcap.scene.types.particles import Particles
from dcap.scene.types.segmentation import Segmentation
from dcap.scene.types.settled import Settled
from tasks.export.fixed_bodies import NearBox, fixed_bodies
from tasks.export.free_body import free_body
from tasks.render.settled_meshes import settled_scene

TOUCHING = 0.02
"""Distance between boxes at rest within which shapes have the friction of their pair, if the piece's is not the main
one [m]."""


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
    simulated = "; it was simulated as a soft one" if thing.soft else ""
    notes = (
        f"the object ({thing.label}) is a rigid body in the shape in which it settled{simulated}",
        f"it collides as {len(thing.pieces)} convex pieces; away from what it touches they may fill hollows a little",
        f"near the object the fixed scene collides as its settled surface, within {1e3 * deviation:.3f} mm",
        "things out of reach of the object collide as one convex hull per part",
    )
    resting = resting_friction(fixed, settled.contact_points, thing.friction)
    return ExportScene(thing, tuple(fixed), pairs_of(thing, fixed), resting, deviation, notes)


def resting_friction(fixed: list[FixedBody], contact: NDArray[np.float64], alone: ContactFriction) -> ContactFriction:
    """The pair's friction on the patch nearest to most points of the contact (k, 3); `alone` without a patch."""
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
