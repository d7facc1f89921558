"""A room as the clients see it: two beds, a sofa, tables with things on them, a shelf, a lamp and the room itself."""

from dcap.language.protocol.requests import InstanceView, IntentRequest, ObjectView, PartView


def part(index: int, name: str, center: tuple[float, float, float], size: tuple[float, float, float]) -> PartView:
    return PartView(index, name, center, size, support_area=size[0] * size[1])


def thing(
    name: str,
    label: str,
    center: tuple[float, float, float],
    size: tuple[float, float, float],
    *parts: PartView,
    front: tuple[float, float, float] | None = None,
    structure: bool = False,
    color: tuple[float, float, float] = (0.5, 0.5, 0.5),
) -> InstanceView:
    (x, y, z), (dx, dy, dz) = center, size
    low, high = (x - dx / 2, y - dy / 2, z - dz / 2), (x + dx / 2, y + dy / 2, z + dz / 2)
    own = parts or (part(0, "body", center, size),)
    return InstanceView(name, label, center, size, low, high, front, structure, color, own)


def bed(name: str, x: float, color: tuple[float, float, float]) -> InstanceView:
    """A bed with its headboard at the far wall (+y) and two pillows."""
    return thing(
        name, "bed", (x, 1.5, 0.45), (1.5, 2.1, 0.9),
        part(0, "frame", (x, 1.5, 0.15), (1.5, 2.1, 0.3)),
        part(1, "mattress", (x, 1.5, 0.4), (1.4, 2.0, 0.2)),
        part(2, "headboard", (x, 2.5, 0.45), (1.5, 0.05, 0.9)),
        part(3, "pillow", (x - 0.35, 2.2, 0.55), (0.6, 0.4, 0.12)),
        part(4, "pillow", (x + 0.35, 2.2, 0.55), (0.6, 0.4, 0.12)),
        front=(0.0, -1.0, 0.0), color=color,
    )  # fmt: skip


ROOM = (
    bed("bed_0", -1.5, (0.2, 0.3, 0.7)),
    bed("bed_1", 1.5, (0.8, 0.2, 0.2)),
    thing(
        "night_0", "bedside table", (0.0, 2.3, 0.25), (0.5, 0.4, 0.5),
        part(0, "top", (0.0, 2.3, 0.49), (0.5, 0.4, 0.02)), part(1, "body", (0.0, 2.3, 0.24), (0.5, 0.4, 0.48)),
        front=(0.0, -1.0, 0.0),
    ),
    thing(
        "lamp_0", "table lamp", (0.1, 2.35, 0.7), (0.25, 0.25, 0.4),
        part(0, "shade", (0.1, 2.35, 0.8), (0.25, 0.25, 0.2)), part(1, "base", (0.1, 2.35, 0.55), (0.1, 0.1, 0.1)),
    ),
    thing(
        "sofa_0", "Multi person sofa", (0.0, -2.3, 0.4), (2.0, 0.9, 0.8),
        part(0, "base", (0.0, -2.3, 0.15), (2.0, 0.9, 0.3)),
        part(1, "seat cushion", (0.0, -2.2, 0.4), (1.6, 0.6, 0.15)),
        part(2, "back", (0.0, -2.65, 0.6), (2.0, 0.2, 0.4)), part(3, "arm", (0.0, -2.3, 0.45), (2.0, 0.9, 0.3)),
        front=(0.0, 1.0, 0.0),
    ),
    thing(
        "desk_0", "desk", (3.0, -0.5, 0.37), (0.7, 1.4, 0.74),
        part(0, "top", (3.0, -0.5, 0.73), (0.7, 1.4, 0.03)), part(1, "leg", (3.0, -0.5, 0.35), (0.7, 1.4, 0.7)),
        front=(-1.0, 0.0, 0.0),
    ),
    thing("laptop_0", "laptop", (3.0, -0.5, 0.84), (0.3, 0.3, 0.2)),
    thing(
        "shelf_0", "bookshelf", (-3.2, -1.0, 0.9), (0.3, 0.9, 1.8),
        part(0, "side", (-3.2, -1.0, 0.9), (0.3, 0.9, 1.8)),
        *(part(1 + k, "board", (-3.2, -1.0, 0.1 + 0.5 * k), (0.3, 0.8, 0.03)) for k in range(4)),
        front=(1.0, 0.0, 0.0),
    ),
    thing(
        "chair_0", "chair", (2.4, -0.5, 0.45), (0.45, 0.45, 0.9),
        part(0, "seat", (2.4, -0.5, 0.45), (0.45, 0.45, 0.04)), part(1, "back", (2.2, -0.5, 0.7), (0.04, 0.45, 0.5)),
        part(2, "leg", (2.4, -0.5, 0.2), (0.4, 0.4, 0.4)),
        front=(1.0, 0.0, 0.0),
    ),
    thing("window_0", "window", (3.4, 1.5, 1.5), (0.1, 1.2, 1.2), structure=True),
    thing("door_0", "door", (-3.4, 2.0, 1.0), (0.1, 0.9, 2.0), structure=True),
    thing("wall_0", "wall", (0.0, 2.9, 1.3), (7.0, 0.1, 2.6), structure=True),
    thing(
        "floor_0", "floor", (0.0, 0.0, -0.05), (7.0, 6.0, 0.1), part(0, "floor", (0.0, 0.0, -0.05), (7.0, 6.0, 0.1)),
        structure=True,
    ),
)  # fmt: skip


def ask(prompt: str, label: str = "thing", size: tuple[float, float, float] = (0.3, 0.2, 0.1)) -> IntentRequest:
    """The intent question for a prompt in the room."""
    parts = (PartView(0, "body", (0.0, 0.0, 0.0), size, 0.1),)
    return IntentRequest(prompt, ObjectView(label, size, parts), ROOM, (0.0, 0.0, 0.0))
