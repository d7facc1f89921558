"""The shell of a room: floor, ceiling, walls with their openings, windows, doors and skirting."""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from dcap.arrays import Array
from dcap.scene.types.mesh import Mesh
from dcap.synthetic.paint import blend, painted
from dcap.synthetic.room import WALLS, FurnishedRoom, Opening, to_room, wall_length
from dcap.synthetic.shapes import Assembly, SolidPart, assembly, columns, line, moved, rounded_box, sheet, sphere

REVEAL = 0.09
"""Depth of windows in the wall [m]."""


@dataclass(frozen=True, eq=False, slots=True)
class BuiltShell:
    """Floor, ceiling, walls, windows and doors of a room."""

    things: tuple[Assembly, ...]
    """Closed solids: windows, doors, skirting (part of its wall)."""
    sheets: tuple[tuple[str, Mesh], ...]
    """Open surfaces with the label of their instance: floor, ceiling, wall south ..."""


def shell(room: FurnishedRoom) -> BuiltShell:
    """Build the shell of a room."""
    sheets = [("floor", _floor(room)), ("ceiling", _ceiling(room))]
    things: list[Assembly] = []
    for name in WALLS:
        openings = [o for o in room.openings if o.wall == name]
        sheets.append((f"wall {name}", _wall(room, name, openings)))
        things.append(Assembly(f"wall {name}", (SolidPart("skirting", tuple(_skirting(room, name, openings))),)))
        things += [_window(room, o) if o.kind == "WINDOW" else _door(room, o) for o in openings]
    return BuiltShell(tuple(things), tuple(sheets))


def _floor(room: FurnishedRoom) -> Mesh:
    surface = sheet(line(0, room.width, 0.04), line(0, room.depth, 0.04), lambda x, y: columns(x, y, np.zeros_like(x)))
    return painted(surface, room.floor, variation=0.015, seed=room.seed)


def _ceiling(room: FurnishedRoom) -> Mesh:
    surface = sheet(
        line(0, room.depth, 0.2), line(0, room.width, 0.2), lambda y, x: columns(x, y, np.full_like(x, room.height))
    )
    return painted(surface, (247, 246, 242), variation=0.006, seed=room.seed + 1)


def _facing(room: FurnishedRoom, mesh: Mesh, target: Array) -> Mesh:
    """The open sheet with its faces turned so that on average they face a point."""
    toward = target - mesh.triangles.mean(axis=1)
    if float(np.einsum("ij,ij->", mesh.face_normals, toward)) > 0:
        return mesh
    return Mesh(mesh.vertices, np.ascontiguousarray(mesh.faces[:, ::-1]), mesh.colors)


def _wall(room: FurnishedRoom, wall: str, openings: Sequence[Opening]) -> Mesh:
    """The inner face of a wall with its openings cut out, and their reveals."""
    cuts_u = [edge for o in openings for edge in (o.at - o.width / 2, o.at + o.width / 2)]
    cuts_z = [edge for o in openings for edge in (o.sill, o.sill + o.height) if edge > 0]
    u, z = _nodes(wall_length(room, wall), cuts_u), _nodes(room.height, cuts_z)
    middle = np.array([room.width / 2, room.depth / 2, room.height / 2])
    flat = sheet(u, z, lambda a, b: columns(a, np.zeros_like(a), b))
    centers = flat.triangles.mean(axis=1)
    open_face = np.zeros(len(centers), dtype=bool)
    for o in openings:
        open_face |= (np.abs(centers[:, 0] - o.at) < o.width / 2) & (
            np.abs(centers[:, 2] - o.sill - o.height / 2) < o.height / 2
        )
    flat = flat.submesh(np.flatnonzero(~open_face))
    inner = _facing(room, Mesh(to_room(room, wall, flat.vertices), flat.faces, flat.colors), middle)
    colored = painted(inner, room.wall, variation=0.008, seed=room.seed + 2)
    return Mesh.concatenate([colored, *(_reveal(room, o) for o in openings)])


def _nodes(length: float, cuts: Sequence[float]) -> Array:
    stops = sorted({0.0, length, *cuts})
    return np.unique(np.concatenate([line(a, b, 0.13) for a, b in pairwise(stops)]))


def _reveal(room: FurnishedRoom, o: Opening) -> Mesh:
    """The four inner faces of an opening."""
    low, high = o.sill, o.sill + o.height
    left, right = o.at - o.width / 2, o.at + o.width / 2
    strips = []
    for start, end in (
        ((left, low), (left, high)),
        ((right, low), (right, high)),
        ((left, high), (right, high)),
        ((left, low), (right, low)),
    ):
        span = float(np.hypot(end[0] - start[0], end[1] - start[1]))
        t = line(0, 1, 0.13 / span)

        def place(a: Array, b: Array, start: tuple[float, float] = start, end: tuple[float, float] = end) -> Array:
            return columns(start[0] + a * (end[0] - start[0]), b, start[1] + a * (end[1] - start[1]))

        strip = sheet(t, np.array([0.0, REVEAL]), place)
        strip = Mesh(to_room(room, o.wall, strip.vertices), strip.faces, strip.colors)
        inside = to_room(room, o.wall, np.array([[o.at, REVEAL / 2, (low + high) / 2]]))
        strips.append(_facing(room, strip, inside))
    return painted(Mesh.concatenate(strips), (240, 239, 234), variation=0.005)


def _in_wall(room: FurnishedRoom, o: Opening, mesh: Mesh) -> Mesh:
    """A solid in wall coordinates (along, outwards, up) about the opening's middle, moved into the room."""
    center = np.array([o.at, 0.0, o.sill + o.height / 2])
    vertices = to_room(room, o.wall, mesh.vertices + center)
    turn = o.wall in ("south", "east")
    return Mesh(vertices, np.ascontiguousarray(mesh.faces[:, ::-1]) if turn else mesh.faces, mesh.colors)


def _window(room: FurnishedRoom, o: Opening) -> Assembly:
    """A pane in front of a bright sky, a frame with a cross, a sill."""

    def sky(points: Array) -> Array:
        height = points[:, 2] / o.height + 0.5
        garden = height < 0.16 + 0.05 * np.sin(9 * points[:, 0])
        return np.where(garden[:, None], (150, 186, 140), blend(height, (232, 242, 248), (150, 196, 236)))

    pane = painted(moved(rounded_box((o.width, 0.012, o.height), 0.003, 0.06), y=REVEAL), sky, variation=0.0)
    bars = [
        moved(rounded_box((o.width + 0.004, 0.05, 0.05), 0.008, 0.05), y=REVEAL - 0.02, z=s * (o.height / 2 - 0.02))
        for s in (-1, 1)
    ]
    bars += [
        moved(rounded_box((0.05, 0.05, o.height), 0.008, 0.05), x=s * (o.width / 2 - 0.02), y=REVEAL - 0.02)
        for s in (-1, 1)
    ]
    bars.append(moved(rounded_box((0.04, 0.045, o.height - 0.02), 0.008, 0.05), y=REVEAL - 0.02))
    ledge = moved(rounded_box((o.width + 0.10, 0.14, 0.03), 0.010, 0.04), y=0.0, z=-o.height / 2 - 0.012)
    solids = [pane, *(painted(m, (250, 250, 248), variation=0.005) for m in (*bars, ledge))]
    return assembly("window", body=[_in_wall(room, o, m) for m in solids])


def _door(room: FurnishedRoom, o: Opening) -> Assembly:
    """A panelled leaf, a casing and a handle."""

    def leaf_paint(points: Array) -> Array:
        x, z = np.abs(points[:, 0]) / (o.width / 2), points[:, 2] / (o.height / 2)
        panel = (x < 0.66) & (np.abs(np.abs(z) - 0.45) < 0.36)
        return np.where(panel[:, None], (222, 214, 200), (236, 229, 216))

    leaf = painted(moved(rounded_box((o.width, 0.04, o.height), 0.006, 0.06), y=0.045), leaf_paint, variation=0.01)
    casing = [
        moved(rounded_box((0.08, 0.03, o.height + 0.07), 0.008, 0.06), x=s * (o.width / 2 + 0.03), z=0.035)
        for s in (-1, 1)
    ]
    casing.append(moved(rounded_box((o.width + 0.14, 0.03, 0.08), 0.008, 0.06), z=o.height / 2 + 0.03))
    handle = [
        moved(sphere(0.026, 0.014), x=0.40 * o.width, y=-0.012, z=-0.02),
        moved(rounded_box((0.02, 0.05, 0.02), 0.006, 0.02), x=0.40 * o.width, y=0.01, z=-0.02),
    ]
    solids = [
        leaf,
        *(painted(m, (246, 242, 234), variation=0.005) for m in casing),
        *(painted(m, (190, 186, 176)) for m in handle),
    ]
    return assembly("door", body=[_in_wall(room, o, m) for m in solids])


def _skirting(room: FurnishedRoom, wall: str, openings: Sequence[Opening]) -> list[Mesh]:
    """Boards along the foot of a wall, interrupted by doors."""
    doors = sorted((o.at - o.width / 2 - 0.07, o.at + o.width / 2 + 0.07) for o in openings if o.kind == "DOOR")
    stops = [0.0, *(edge for door in doors for edge in door), wall_length(room, wall)]
    boards = []
    for start, end in zip(stops[::2], stops[1::2], strict=True):
        if end - start > 0.05:
            middle = Opening(wall, (start + end) / 2, end - start, -0.006, 0.09, "SKIRTING")
            board = painted(rounded_box((end - start, 0.024, 0.09), 0.005, 0.10), (248, 247, 243), variation=0.005)
            boards.append(_in_wall(room, middle, board))
    return boards
