"""Builders of solver bodies from primitives, shared by the physics tests."""

import json
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from dcap.geometry import distance
from dcap.geometry.distance import MeshDistance
from dcap.geometry.primitives import Box, Capsule, Cylinder
from dcap.geometry.solid.fill import fill
from dcap.geometry.solid.repair import mass_properties
from dcap.scene.types.mesh import Mesh
from perf.peers.reference import DEPTH
from solver.config import SolverConfig
from solver.model.bodies import HELD, Interior, Model, RigidBody, SignedDistance, SoftBody
from solver.model.grid import graded_planes
from solver.model.layers import Layers
from solver.settle import settle
from tasks.case.run import run_case

GRAVITY = 9.81


def sampled(field, low, high, spacing):
    """A signed distance on a grid."""
    axes = [np.arange(a, b + spacing, spacing) for a, b in zip(low, high, strict=True)]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    return SignedDistance(np.array([a[0] for a in axes]), spacing, field(points).astype(np.float32))


def rigid(
    name,
    solid,
    position,
    *,
    mass=1.0,
    fixed=False,
    mu=(0.5, 0.4),
    rolling=0.0,
    rotation=None,
    edge=0.01,
    spacing=0.002,
    **start,
):
    """A rigid primitive."""  # fmt: skip
    turn, position = np.eye(3) if rotation is None else rotation, np.asarray(position, dtype=float)
    surface = solid.surface(edge)
    vertices = surface.vertices @ turn.T + position
    grid = sampled(
        lambda p: solid.distance((p - position) @ turn), vertices.min(0) - 0.02, vertices.max(0) + 0.02, spacing
    )
    inertia = turn @ np.diag(solid.inertia_per_mass * mass) @ turn.T
    return RigidBody(
        name, fixed, vertices, surface.faces, grid, mass, position, mu[0], mu[1], rolling, inertia, **start
    )


def rigid_mesh(name, mesh, position, *, mass=1.0, mu=(0.5, 0.4), rolling=0.0, rotation=None, spacing=0.0015, **start):
    """A free rigid body from a closed mesh of uniform density, its own origin at `position`."""
    turn = np.eye(3) if rotation is None else rotation
    placed = Mesh.of(mesh.vertices @ turn.T + np.asarray(position, dtype=float), mesh.faces)
    low, high = placed.bounds
    grid = distance.sampled(MeshDistance(placed), low - 0.01, high + 0.01, spacing)
    natural, center, inertia = mass_properties(placed, 1000.0)
    sdf = SignedDistance(grid.origin, grid.spacing, grid.values)
    inertia = inertia * mass / natural
    return RigidBody(
        name, False, placed.vertices, placed.faces, sdf, mass, center, mu[0], mu[1], rolling, inertia, **start
    )


def floor(**options):
    """A fixed slab whose top is the plane z = 0."""
    return rigid(
        "floor", Box(np.array([0.6, 0.6, 0.05])), [0, 0, -0.025], fixed=True, edge=0.02, spacing=0.004, **options
    )


def soft(
    name,
    solid,
    position,
    *,
    E,
    nu=0.3,
    rho=200.0,
    cell=0.01,
    planes=None,
    held=None,
    fixed=False,
    loaded=False,
    mu=(0.5, 0.4),
    edge=None,
    spacing=None,
    layers=None,
    rolling=0.0,
):
    """A soft primitive; `held` marks held nodes. `layers` is (E_p, nu_p, G_t, normal): E and nu are then across."""
    position = np.asarray(position, dtype=float)
    if isinstance(solid, Box) and planes:  # a surface as fine as the cells under it
        half = solid.half_extents
        surface = solid.surface_on([np.unique(np.clip(planes[a] - position[a], -half[a], half[a])) for a in range(3)])
    else:
        surface = solid.surface(edge or cell)
    vertices = surface.vertices + position
    low, high = vertices.min(0), vertices.max(0)
    planes = planes or tuple(graded_planes(a, b, a, b, cell) for a, b in zip(low, high, strict=True))
    points, volume = fill(planes, lambda p: solid.distance(p - position))
    one = np.ones(len(points))
    state = np.zeros(tuple(len(p) for p in planes), np.int8)
    if held is not None:
        state[held] = HELD
    grid = sampled(lambda p: solid.distance(p - position), low - 0.02, high + 0.02, spacing or cell / 3)
    if layers is not None:
        normal = np.asarray(layers[3], dtype=float) / np.linalg.norm(layers[3])
        layers = Layers(layers[0] * one, layers[1] * one, layers[2] * one, np.tile(normal, (len(points), 1)))
    interior = Interior(points, volume, rho * one, E * one, nu * one, planes, state, loaded, layers)
    return SoftBody(
        name, fixed, vertices, surface.faces, grid, rho * solid.volume, position, mu[0], mu[1], rolling, interior
    )


def drop(*bodies, gravity=(0.0, 0.0, -GRAVITY), **config):
    """Settle the bodies."""
    return settle(Model(tuple(bodies), np.asarray(gravity, dtype=float)), SolverConfig(threads=2, **config))


# the reference drop: a ball on a slab of 0.4 x 0.4 m that is held at its bottom
RADIUS, THICK = 0.05, 0.15


def reference_drop(folder, mass, E, resolution="auto", solver="tl"):
    """result.json of the reference drop as a case file, and the depth [m]: undeformed top minus lowest point."""
    material = {"density": 200, "youngs_modulus": E, "poisson_ratio": 0.3, "static_friction": 0.5,
                "dynamic_friction": 0.4}  # fmt: skip
    case = {
        "resolution": resolution,
        "bodies": [
            {"name": "slab", "shape": {"box": {"size": [0.4, 0.4, THICK]}}, "position": [0, 0, THICK / 2],
             "motion": "fixed", "material": material},
            {"name": "ball", "shape": {"sphere": {"radius": RADIUS}}, "position": [0, 0, THICK + RADIUS + 0.01],
             "mass": mass, "material": "steel"},
        ],
    }  # fmt: skip
    folder.mkdir(exist_ok=True)
    path = folder / "case.yaml"
    path.write_text(json.dumps(case))
    result: Any = run_case(path, folder / "out", solver=solver, threads=2, quiet=True)
    assert result["verdict"] == "at_rest"
    return result, THICK - result["bodies"]["ball"]["aabb"][0][2]


@pytest.fixture(scope="session")
def lab():
    """Everything a physics test needs to build a scene."""
    return SimpleNamespace(
        rigid=rigid, rigid_mesh=rigid_mesh, soft=soft, floor=floor, drop=drop, Box=Box, Capsule=Capsule,
        Cylinder=Cylinder, planes=graded_planes, gravity=GRAVITY, reference_drop=reference_drop, radius=RADIUS,
        thick=THICK, known_depth=DEPTH,
    )  # fmt: skip
