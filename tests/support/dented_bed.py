"""A ball that lies in a round dent of a bed in a small room, all by formula: what pictures and maps are taken of."""

from functools import cache

import numpy as np
import trimesh
from rest_records import history, implicit_certificate

from dcap.geometry.solid.repair import subdivide_near
from dcap.scene.types.boxes import OrientedBox
from dcap.scene.types.choices import Anchor
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.segmentation import Instance, Part, Segmentation
from dcap.scene.types.settled import Settled, SettledBody
from solver.certificate import Verdict

RADIUS, DEPTH, TOP = 0.1, 0.03, 0.5
"""Of the ball, of its dent, and height of the bed [m]."""


def box_mesh(low: tuple[float, ...], high: tuple[float, ...], color: tuple[int, int, int] = (200, 200, 200)) -> Mesh:
    """A closed box."""
    a, b = np.array(low), np.array(high)
    mesh = trimesh.creation.box(b - a)
    return Mesh.of(mesh.vertices + (a + b) / 2, mesh.faces, color)


def around(mesh: Mesh) -> OrientedBox:
    """The upright box of a mesh."""
    low, high = mesh.bounds
    return OrientedBox((low + high) / 2, np.eye(3), (high - low) / 2)


def scene_of(**more: Mesh) -> Segmentation:
    """A mattress that looks south, a floor, a wall behind, a wall in front, and further things."""
    meshes = {
        "bed": box_mesh((-0.8, -1.0, 0.0), (0.8, 1.0, TOP), (220, 220, 230)),
        "floor": box_mesh((-3, -3, -0.05), (3, 3, 0.0), (150, 110, 80)),
        "wall_back": box_mesh((-3, 1.2, 0.0), (3, 1.3, 2.5)),
        "wall_front": box_mesh((-3, -1.8, 0.0), (3, -1.7, 2.5)),
        **more,
    }
    instances = tuple(
        Instance(
            name, name.split("_")[0], around(m), (Part("body", around(m), 1.0),),
            np.array([0.0, -1.0, 0.0]) if name == "bed" else None, name.startswith(("wall", "floor")),
        )
        for name, m in meshes.items()
    )  # fmt: skip
    counts = [len(m.faces) for m in meshes.values()]
    owner = np.repeat(np.arange(len(meshes)), counts).astype(np.int32)
    return Segmentation(Mesh.concatenate(list(meshes.values())), instances, owner, np.zeros_like(owner))


def ball() -> Segmentation:
    """A red ball."""
    mesh = trimesh.creation.icosphere(3, RADIUS)
    own = Mesh.of(mesh.vertices, mesh.faces, (200, 60, 40))
    one = Instance("object", "ball", around(own), (Part("body", around(own), 1.0),), None)
    zeros = np.zeros(len(own.faces), dtype=np.int32)
    return Segmentation(own, (one,), zeros, zeros)


def anchor() -> Anchor:
    """The ball 1 cm above the middle of the bed."""
    pose = np.eye(4)
    pose[2, 3] = TOP + RADIUS + 0.01
    square = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])
    return Anchor("bed", "body", 0, "center", np.zeros(2), np.array([0, 0, TOP]), pose, 0.01, square, "test")


@cache
def settled() -> Settled:
    """The ball has sunk in by DEPTH; the bed has a round dent, and a turn of the ball about z for good measure."""
    fall = np.array([0.0, 0.0, -0.01 - DEPTH])
    turn = np.array([np.cos(0.25), 0.0, 0.0, np.sin(0.25)])
    matrix = np.array([[np.cos(0.5), -np.sin(0.5), 0], [np.sin(0.5), np.cos(0.5), 0], [0, 0, 1]])
    start = ball().mesh.transformed(anchor().world_from_object)
    end = start.vertices @ matrix.T + fall
    own = SettledBody("object", Mesh(end, start.faces, start.colors), fall, turn, end - start.vertices)
    top = Mesh.of([[-0.4, -0.4, TOP], [0.4, -0.4, TOP], [0.4, 0.4, TOP], [-0.4, 0.4, TOP]], [[0, 1, 2], [0, 2, 3]])
    fine = subdivide_near(top, np.array([[-0.15, -0.15, 0], [0.15, 0.15, 1]]), 0.015)
    away = np.linalg.norm(fine.vertices[:, :2], axis=1)
    sphere = np.sqrt(np.clip(RADIUS**2 - away**2, 0.0, None)) - (RADIUS - DEPTH)
    down = np.zeros_like(fine.vertices)
    down[:, 2] = -np.clip(sphere, 0.0, None)
    dented = Mesh(fine.vertices + down, fine.faces, fine.colors)
    zero = np.zeros(3)
    bed = SettledBody("bed", dented, zero, np.array([1.0, 0, 0, 0]), down)
    contact = dented.vertices[-down[:, 2] > 1e-3]
    return Settled(Verdict.AT_REST, (own, bed), (), contact, implicit_certificate(), history(1), 1, 0.1, ())
