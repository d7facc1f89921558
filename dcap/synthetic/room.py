"""A furnished room in its own frame: [0, width] x [0, depth], floor at z = 0.

Walls are named by the compass: south y = 0, north y = depth, west x = 0, east x = width.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np

from dcap.arrays import Array
from dcap.synthetic.paint import Finish, Painter
from dcap.synthetic.shapes import Assembly, columns, rotation

WALL_THICKNESS = 0.12
"""Thickness of the walls [m]."""
WALLS = ("south", "east", "north", "west")
YAW = {"south": 0.0, "east": 90.0, "north": 180.0, "west": -90.0}
"""Rotation of a piece whose back is to the wall [degrees]."""


@dataclass(frozen=True, slots=True)
class Opening:
    """A window or door."""

    wall: str
    at: float
    """Middle along the wall, along x or y [m]."""
    width: float
    sill: float
    """Height of the lower edge [m]; 0 for a door."""
    height: float
    kind: str
    """WINDOW or DOOR."""


@dataclass(frozen=True, eq=False, slots=True)
class Placed:
    """A piece in its place."""

    thing: Assembly
    """The piece in room coordinates."""
    yaw_deg: float
    x: float
    y: float

    @property
    def top(self) -> float:
        """Height of the highest point of the piece [m]."""
        return float(self.thing.bounds[1, 2])

    def point(self, right: float, front: float) -> tuple[float, float]:
        """A point given in the piece's own frame, in room coordinates [m]."""
        offset = rotation("z", self.yaw_deg) @ (right, front, 0.0)
        return self.x + float(offset[0]), self.y + float(offset[1])


@dataclass(eq=False, slots=True)
class FurnishedRoom:
    """A room while it is being furnished."""

    kind: str
    """Room type as InteriorGS writes it."""
    width: float
    depth: float
    height: float
    wall: Finish
    floor: Painter
    seed: int
    openings: Sequence[Opening] = ()
    things: list[Placed] = field(default_factory=list)

    def put(self, item: Assembly, x: float, y: float, yaw_deg: float = 0.0, z: float = 0.0) -> Placed:
        """Put a piece anywhere."""
        placed = Placed(item.placed(x, y, z, yaw_deg), yaw_deg, x, y)
        self.things.append(placed)
        return placed

    def stand(self, item: Assembly, x: float, y: float) -> Placed:
        """Put a piece on the floor, moved inwards as far as necessary to clear the walls by 2 cm."""
        low, high = item.bounds
        x = float(np.clip(x, 0.02 - low[0], self.width - 0.02 - high[0]))
        y = float(np.clip(y, 0.02 - low[1], self.depth - 0.02 - high[1]))
        return self.put(item, x, y)

    def against(self, item: Assembly, wall: str, along: float, gap: float = 0.02, z: float = 0.0) -> Placed:
        """Put a piece with its back to a wall; `along` is measured along x or y [m]."""
        behind = gap - float(item.bounds[0, 1])
        x, y = self.on_wall(wall, along, behind)
        return self.put(item, x, y, YAW[wall], z)

    def on_wall(self, wall: str, along: float, inwards: float) -> tuple[float, float]:
        """The point `inwards` of a wall [m]."""
        return {
            "south": (along, inwards),
            "north": (along, self.depth - inwards),
            "west": (inwards, along),
            "east": (self.width - inwards, along),
        }[wall]

    def upon(self, item: Assembly, below: Placed, right: float = 0.0, front: float = 0.0, yaw_deg: float = 0.0,
             top: float | None = None) -> Placed:  # fmt: skip
        """Put a piece on another piece at a point of its frame, pressed in by 1.5 mm so that they touch."""
        x, y = below.point(right, front)
        height = below.top if top is None else top
        return self.put(item, x, y, below.yaw_deg + yaw_deg, height - 0.0015 - float(item.bounds[0, 2]))


def wall_length(room: FurnishedRoom, wall: str) -> float:
    """Length of a wall [m]."""
    return room.width if wall in ("south", "north") else room.depth


def to_room(room: FurnishedRoom, wall: str, points: Array) -> Array:
    """Wall coordinates (along, outwards, up) to the room's, shape (n, 3)."""
    along, outwards, up = points.T
    return {
        "south": columns(along, -outwards, up),
        "north": columns(along, room.depth + outwards, up),
        "west": columns(-outwards, along, up),
        "east": columns(room.width + outwards, along, up),
    }[wall]
