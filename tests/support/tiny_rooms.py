"""Many tiny rooms of labelled boxes, as GLB files with a node per thing: scenes for data sets, each a few kilobytes."""

from pathlib import Path

import numpy as np
import trimesh

from dcap.scene.types.mesh import Mesh
from dcap.scene.writers.glb import Node, glb_bytes

Size = tuple[float, float, float]
Piece = tuple[str, Size, Size]
"""A part: name, lowest corner from the thing's lowest corner, size."""


def table(x: float, y: float, z: float) -> list[Piece]:
    legs = [("leg", (a, b, 0.0), (0.05, 0.05, z - 0.04)) for a in (0.02, x - 0.07) for b in (0.02, y - 0.07)]
    return [("top", (0.0, 0.0, z - 0.04), (x, y, 0.04)), *legs]


def case(x: float, y: float, z: float) -> list[Piece]:
    return [("body", (0.0, 0.0, 0.0), (x, y, z - 0.03)), ("top", (0.0, 0.0, z - 0.03), (x, y, 0.03))]


def bed(x: float, y: float, z: float) -> list[Piece]:
    return [
        ("frame", (0.0, 0.0, 0.0), (x, y, z - 0.2)),
        ("mattress", (0.03, 0.03, z - 0.2), (x - 0.06, y - 0.06, 0.2)),
        ("headboard", (0.0, y, 0.0), (x, 0.05, z + 0.5)),
        ("pillow", (0.2, y - 0.5, z), (0.6, 0.4, 0.12)),
    ]


def seat(x: float, y: float, z: float) -> list[Piece]:
    return [
        ("base", (0.0, 0.0, 0.0), (x, y, z - 0.15)),
        ("seat cushion", (0.15, 0.0, z - 0.15), (x - 0.3, y - 0.2, 0.15)),
        ("back", (0.0, y - 0.2, z), (x, 0.2, 0.4)),
    ]


def stool(x: float, y: float, z: float) -> list[Piece]:
    return [("seat", (0.0, 0.0, z - 0.08), (x, y, 0.08)), ("leg", (0.05, 0.05, 0.0), (x - 0.1, y - 0.1, z - 0.08))]


def whole(x: float, y: float, z: float) -> list[Piece]:
    return [("body", (0.0, 0.0, 0.0), (x, y, z))]


FURNITURE = {
    "bed": (bed, (1.6, 2.0, 0.5)), "nightstand": (case, (0.45, 0.4, 0.5)), "desk": (table, (1.4, 0.7, 0.74)),
    "dining table": (table, (1.6, 0.9, 0.75)), "coffee table": (table, (1.0, 0.6, 0.42)),
    "sofa": (seat, (2.0, 0.9, 0.45)),
    "armchair": (seat, (0.9, 0.85, 0.44)), "stool": (stool, (0.4, 0.4, 0.45)), "cabinet": (case, (0.9, 0.45, 0.9)),
    "bench": (stool, (1.2, 0.4, 0.45)), "chair": (stool, (0.45, 0.45, 0.46)), "rug": (whole, (1.6, 1.1, 0.01)),
    "wardrobe": (whole, (1.2, 0.6, 2.0)), "teatable": (table, (0.9, 0.55, 0.4)),
    "storage cabinet": (case, (1.0, 0.4, 0.8)),
}  # fmt: skip
"""How each label is built, and its usual size [m]."""
ON_TOP = {
    "table lamp": (0.2, 0.2, 0.4),
    "book": (0.22, 0.16, 0.04),
    "vase": (0.12, 0.12, 0.25),
    "clock": (0.15, 0.08, 0.15),
}
CARRYING = ("nightstand", "desk", "dining table", "coffee table", "cabinet", "teatable", "storage cabinet")


def solid(low: Size, size: Size) -> Mesh:
    shape = trimesh.creation.box(bounds=np.array([low, np.add(low, size)]))
    return Mesh.of(shape.vertices, shape.faces)


def room_nodes(rng: np.random.Generator, things: int) -> list[Node]:
    """A floor and so many pieces of furniture in a row of cells, some twice, some with a thing on top."""
    cell, columns = 2.8, 3
    chosen = [str(name) for name in rng.choice(list(FURNITURE), size=things)]
    width, depth = cell * columns, cell * (-(-things // columns))
    nodes = [Node("floor_0", label="floor", children=(Node("floor", solid((0, 0, -0.05), (width, depth, 0.05))),))]
    for index, label in enumerate(chosen):
        build, usual = FURNITURE[label]
        x, y, z = (float(side * rng.uniform(0.85, 1.15)) for side in usual)
        corner = (cell * (index % columns) + 0.3, cell * (index // columns) + 0.3, 0.0)
        parts = build(x, y, z)
        children = [Node(name, solid(tuple(np.add(corner, low)), size)) for name, low, size in parts]
        nodes.append(Node(f"{label.replace(' ', '_')}_{index}", label=label, children=tuple(children)))
        if label in CARRYING and rng.random() < 0.5:
            top = str(rng.choice(list(ON_TOP)))
            size = ON_TOP[top]
            low = (corner[0] + 0.05, corner[1] + 0.05, z)
            nodes.append(
                Node(f"{top.replace(' ', '_')}_{index}", label=top, children=(Node("body", solid(low, size)),))
            )
    return nodes


def write_tiny_rooms(folder: Path, count: int, seed: int = 0) -> list[Path]:
    """So many rooms, `room_000.glb` and so on, each with 3 to 9 pieces of furniture."""
    folder.mkdir(parents=True, exist_ok=True)
    paths = []
    for number in range(count):
        rng = np.random.default_rng([seed, number])
        path = folder / f"room_{number:03}.glb"
        path.write_bytes(glb_bytes(room_nodes(rng, int(rng.integers(3, 10)))))
        paths.append(path)
    return paths


def write_tiny_objects(folder: Path) -> list[Path]:
    """A ball, a mug, a book and a wardrobe, as boxes and balls."""
    folder.mkdir(parents=True, exist_ok=True)
    ball = trimesh.creation.icosphere(2, 0.1)
    shapes = {
        "ball": Mesh.of(ball.vertices, ball.faces),
        "bottle": solid((-0.035, -0.035, 0.0), (0.07, 0.07, 0.25)),
        "mug": solid((-0.04, -0.04, 0.0), (0.08, 0.08, 0.1)),
        "book": solid((-0.08, -0.11, 0.0), (0.16, 0.22, 0.03)),
        "wardrobe": solid((-0.6, -0.3, 0.0), (1.2, 0.6, 2.0)),
    }
    paths = []
    for name, mesh in shapes.items():
        paths.append(folder / f"{name}.glb")
        paths[-1].write_bytes(glb_bytes([Node(name, mesh)]))
    return paths
