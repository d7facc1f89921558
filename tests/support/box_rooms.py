"""Rooms and things made of boxes, balls and cylinders, small enough to compute every answer by hand."""

from collections.abc import Sequence

import numpy as np
import trimesh

from dcap.scene.types.boxes import OrientedBox
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.segmentation import Instance, Part, Segmentation

Corner = tuple[float, float, float]
Solid = tuple[str, Mesh]
STRUCTURE = ("floor", "wall", "window", "door", "ceiling")


def block(low: Corner, high: Corner) -> Mesh:
    """An axis-aligned box of twelve triangles."""
    shape = trimesh.creation.box(bounds=[low, high])
    return Mesh.of(shape.vertices, shape.faces)


def box_of(mesh: Mesh) -> OrientedBox:
    low, high = mesh.bounds
    return OrientedBox((low + high) / 2, np.eye(3), np.maximum((high - low) / 2, 1e-6))


Things = dict[str, tuple[str, Corner | None, Sequence[Solid]]]
"""Label, front and named solids by id."""


def segmentation(things: Things) -> Segmentation:
    """Instances by id: label, front and named solids."""
    instances, meshes, face_instance, face_part = [], [], [], []
    for index, (name, (label, front, solids)) in enumerate(things.items()):
        parts = tuple(Part(part, box_of(mesh), 1.0) for part, mesh in solids)
        whole = Mesh.concatenate([mesh for _, mesh in solids])
        ahead = None if front is None else np.array(front)
        structure = label in STRUCTURE
        instances.append(Instance(name, label, box_of(whole), parts, ahead, structure))
        for number, (_, mesh) in enumerate(solids):
            meshes.append(Mesh.of(mesh.vertices, mesh.faces))  # without colours
            face_instance += [index] * len(mesh.faces)
            face_part += [number] * len(mesh.faces)
    mesh = Mesh.concatenate(meshes)
    return Segmentation(mesh, tuple(instances), np.array(face_instance, np.int32), np.array(face_part, np.int32))


def bedroom() -> Segmentation:
    """A bed with headboard at +y and two pillows, a table with a lamp that has a conical shade, a floor, a wall."""
    shade = trimesh.creation.cone(radius=0.2, height=0.2, sections=32)
    shade.apply_translation((2.0, 1.0, 0.75))
    return segmentation(
        {
            "bed": (
                "bed",
                (0.0, -1.0, 0.0),
                [
                    ("frame", block((-0.8, -1.0, 0.0), (0.8, 1.0, 0.3))),
                    ("mattress", block((-0.75, -0.95, 0.3), (0.75, 0.95, 0.5))),
                    ("headboard", block((-0.8, 1.0, 0.0), (0.8, 1.06, 1.0))),
                    ("pillow", block((-0.65, 0.5, 0.5), (-0.05, 0.9, 0.62))),
                    ("pillow", block((0.05, 0.5, 0.5), (0.65, 0.9, 0.62))),
                ],
            ),
            "table": (
                "table",
                None,
                [
                    ("top", block((1.6, 0.6, 0.46), (2.4, 1.4, 0.5))),
                    ("leg", block((1.95, 0.95, 0.0), (2.05, 1.05, 0.46))),
                ],
            ),
            "lamp": ("table lamp", None, [("shade", Mesh.of(shade.vertices, shade.faces)),
                                          ("base", block((1.95, 0.95, 0.5), (2.05, 1.05, 0.75)))]),
            "floor": ("floor", None, [("floor", block((-3, -3, -0.1), (3, 3, 0.0)))]),
            "wall": ("wall", None, [("wall", block((-3, 3, 0), (3, 3.1, 2.5)))]),
        }
    )  # fmt: skip


def thing(label: str, mesh: Mesh, part: str = "body") -> Segmentation:
    return segmentation({"object": (label, None, [(part, mesh)])})


def ball(radius: float = 0.1) -> Mesh:
    shape = trimesh.creation.icosphere(subdivisions=3, radius=radius)
    return Mesh.of(shape.vertices, shape.faces)


def mug() -> Mesh:
    """A cylinder with a handle on +x that ends over the table."""
    cup = trimesh.creation.cylinder(radius=0.042, height=0.1, sections=48)
    return Mesh.concatenate([Mesh.of(cup.vertices, cup.faces), block((0.042, -0.006, -0.03), (0.075, 0.006, 0.03))])


def book() -> Mesh:
    return block((-0.08, -0.115, 0.0), (0.08, 0.115, 0.03))


def toy() -> Mesh:
    """A seated figure that looks along -y: body and legs before it."""
    return Mesh.concatenate(
        [block((-0.08, -0.05, 0.0), (0.08, 0.05, 0.3)), block((-0.08, -0.2, 0.0), (0.08, -0.05, 0.07))]
    )


def hall() -> Segmentation:
    """A floor with a rug under a table, a bench by the wall at -y with a chair beside it, a door at -x."""
    return segmentation(
        {
            "floor": ("floor", None, [("floor", block((-2, -2, -0.1), (2, 2, 0.0)))]),
            "rug": ("rug", None, [("body", block((-1, -0.6, 0.0), (1, 0.6, 0.012)))]),
            "table": ("table", None, [("top", block((-0.6, -0.4, 0.46), (0.6, 0.4, 0.5))),
                                      ("leg", block((-0.02, -0.02, 0.012), (0.02, 0.02, 0.46)))]),
            "bench": ("bench", (0.0, 1.0, 0.0), [("seat", block((-0.5, -1.9, 0.0), (0.5, -1.5, 0.45)))]),
            "chair": ("chair", (0.0, 1.0, 0.0), [("seat", block((0.9, -1.9, 0.0), (1.3, -1.5, 0.45)))]),
            "stove": ("stove", (0.0, -1.0, 0.0), [("top", block((-0.3, 1.6, 0.0), (0.3, 2.0, 0.85)))]),
            "door": ("door", (-1.0, 0.0, 0.0), [("body", block((-2.05, 0.2, 0.0), (-1.97, 1.2, 2.0)))]),
        }
    )  # fmt: skip


ROOM = bedroom()
HALL = hall()
CUBE = thing("cube", block((-0.03, -0.03, 0.0), (0.03, 0.03, 0.06)))
