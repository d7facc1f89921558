"""Meshes touch where they are, not where their box, hull or symmetry would be."""

import numpy as np
import pytest
import trimesh
from scipy.spatial import ConvexHull, Delaunay
from scipy.spatial.transform import Rotation

from dcap.scene.types.mesh import Mesh
from dcap.synthetic.dataset import build_object

PENETRATION = 1e-4  # twice the penetration target of 0.05 mm: a body leans on unequally loaded points [m]


def household(name):
    """A procedural object of the data set in metres."""
    mesh = Mesh.concatenate([solid for part in build_object(name).parts for solid in part.solids])
    return Mesh.of(0.01 * mesh.vertices, mesh.faces)


def resting_points(result, mesh, index=0):
    """Where the surface of the body lies at rest, and which of its points touch a plane z = 0."""
    body = result.bodies[index]
    placed = mesh.vertices @ body.rotation.T + body.translation
    return placed, placed[:, 2] < placed[:, 2].min() + PENETRATION


@pytest.mark.slow
def test_a_mug_on_its_side_rests_on_a_face_of_its_hull(lab):
    """A rigid body rests on a plane on a face of its convex hull that has the centre of mass above it, here with the
    handle as one of the feet or lying flat; the points that carry it are vertices of that face."""
    mesh = household("mug")
    turn = Rotation.from_euler("yx", [90, 35], degrees=True).as_matrix()
    turned = Mesh.of(mesh.vertices @ turn.T, mesh.faces)
    start = np.array([0, 0, 5e-4 - turned.bounds[0, 2]])
    body = lab.rigid_mesh("mug", turned, start, mass=0.3, rolling=1e-3)
    result = lab.drop(body, lab.floor(rolling=1e-3))
    placed, touching = resting_points(result, Mesh.of(body.vertices, body.faces))
    center = result.bodies[0].rotation @ body.center_of_mass + result.bodies[0].translation
    assert result.verdict == "at_rest"
    assert abs(placed[:, 2].min()) < PENETRATION
    # the face: no vertex of the hull below it, and at least three points on it, not on a line
    feet = placed[touching][:, :2]
    assert Delaunay(feet).find_simplex(center[:2]) >= 0
    hull = set(ConvexHull(placed).vertices)
    assert hull & set(np.flatnonzero(touching))
    # contact is reported at those points and nowhere else
    reported = result.contact_points["mug"]
    near = Delaunay(feet + 1.0).find_simplex(reported[:, :2] + 1.0) >= 0
    distance = np.linalg.norm(reported[:, None, :2] - feet[None], axis=2).min(axis=1)
    assert (near | (distance < 2e-3)).all()


def arch():
    """A gate: a lintel on two posts, 0.16 m wide outside, opening 0.1 m wide and 0.1 m high, standing on z = 0."""
    outer = trimesh.creation.box([0.16, 0.06, 0.13], trimesh.transformations.translation_matrix([0, 0, 0.065]))
    opening = trimesh.creation.box([0.1, 0.1, 0.1], trimesh.transformations.translation_matrix([0, 0, 0.05]))
    gate = trimesh.boolean.difference([outer, opening], engine="manifold")
    for _ in range(3):
        gate = gate.subdivide()
    return Mesh.of(gate.vertices, gate.faces)


@pytest.mark.parametrize(("height", "gate_at"), [(0.09, 0.0), (0.115, 0.015)])
def test_a_gate_stands_over_what_fits_under_it_and_on_what_does_not(lab, height, gate_at):
    """A block 1 cm lower than the opening is not touched; one 1.5 cm higher carries the lintel and lifts the posts."""
    gate = lab.rigid_mesh("gate", arch(), [0, 0, gate_at + 1e-3], mass=1.0)
    block = lab.rigid("block", lab.Box(np.array([0.08, 0.2, height])), [0, 0, height / 2], fixed=True)
    result = lab.drop(gate, block, lab.floor())
    assert result.verdict == "at_rest"
    assert result.bodies[0].translation[2] == pytest.approx(0.0, abs=0.02)
    assert result.bodies[0].vertices[:, 2].min() == pytest.approx(gate_at, abs=PENETRATION)
    touched = {row.a for row in result.contacts} | {row.b for row in result.contacts}
    assert touched == {"gate", "floor" if gate_at == 0.0 else "block"}
    heights = result.contact_points["gate"][:, 2]
    assert heights == pytest.approx(np.full(len(heights), 0.1 + gate_at if gate_at else 0.0), abs=PENETRATION)


@pytest.mark.slow
@pytest.mark.parametrize("share", [0.9, 1.1])
def test_a_mug_topples_iff_its_centre_of_mass_passes_its_foot(lab, share):
    """On a slope that is too rough to slide on: tan(a) = (foot's reach downhill) / (height of the centre of mass)."""
    mesh = household("mug")
    low = mesh.bounds[0, 2]
    body = lab.rigid_mesh("mug", mesh, [0, 0, 2e-5 - low], mass=0.3, mu=(3.0, 3.0))
    foot = body.vertices[body.vertices[:, 2] < 5e-5]
    reach, height = foot[:, 0].max() - body.center_of_mass[0], body.center_of_mass[2]
    angle = np.arctan(share * reach / height)
    gravity = lab.gravity * np.array([np.sin(angle), 0.0, -np.cos(angle)])
    result = lab.drop(body, lab.floor(mu=(3.0, 3.0)), gravity=gravity, step_limit=150)
    turned = np.degrees(Rotation.from_matrix(result.bodies[0].rotation).magnitude())
    assert (turned < 1.0) == (share < 1.0)
