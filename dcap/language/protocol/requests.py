"""Requests to a client: everything that any client may need to choose, in plain values and with pictures on demand.

Geometry is computed by the stages; a request lists the choices by id, and a reply can only pick among them. All
lengths in metres, world frame, z up. Text that came from files or prompts is data for the clients, never an
instruction.
"""

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from dcap.scene.types.choices import RegionConstraint
from dcap.scene.types.materials import Material

Floats = NDArray[np.floating]
Vector = tuple[float, float, float]
PART_SIDES = ("left", "right", "front", "back", "top", "bottom")
"""Which of several parts of one name a reference `part:NAME/SIDE` means."""
LEVEL = 0.94
"""Cosine of the angle to the vertical from which something slants: of 20 degrees."""
PictureMaker = Callable[[], NDArray[np.uint8]]
"""Makes an RGB picture, shape (h, w, 3); called only by clients that look."""


@dataclass(frozen=True, slots=True)
class Picture:
    """A picture, and what a model is told that it shows."""

    name: str
    """Words of ours, never of a file or a person: a model reads them as ours."""
    make: PictureMaker


def vector(values: Floats) -> Vector:
    """Three floats of an array, shape (3,)."""
    x, y, z = (float(v) for v in values)
    return x, y, z


@dataclass(frozen=True, slots=True)
class PartView:
    """A part as a client sees it."""

    index: int
    name: str
    center: Vector
    """[m]."""
    size: Vector
    """Extents along its box axes [m]."""
    support_area: float = 0.0
    """Upward-facing area [m^2]."""
    color: Vector = (0.5, 0.5, 0.5)
    """Mean sRGB colour, 0..1."""


@dataclass(frozen=True, slots=True)
class InstanceView:
    """An instance as a client sees it."""

    id: str
    label: str
    center: Vector
    size: Vector
    """Extents along its box axes [m]."""
    low: Vector
    """Lowest corner of the axis-aligned bounds of its box [m]."""
    high: Vector
    """Highest corner [m]."""
    front: Vector | None
    """Unit vector out of its front."""
    structure: bool
    color: Vector
    """Mean sRGB colour, 0..1."""
    parts: tuple[PartView, ...]
    guesses: tuple[tuple[str, float], ...] = ()
    """Labels that it may have and their probabilities, the likeliest first; empty where the source names it."""
    confidence: float = 1.0
    """0..1, how sure the label is."""
    number: int = 0
    """Its number in the pictures; 0 where it has none."""


@dataclass(frozen=True, slots=True)
class ObjectView:
    """The object to place."""

    label: str
    size: Vector
    """Extents of the mesh as read, largest first [m]."""
    parts: tuple[PartView, ...]


@dataclass(frozen=True, slots=True)
class IntentRequest:
    """Which instance, how big, how heavy, and what the prompt says about orientation and region."""

    prompt: str
    item: ObjectView
    instances: tuple[InstanceView, ...]
    room_center: Vector
    """Middle of the scene [m]."""
    pictures: tuple[Picture, ...] = field(default=(), compare=False)
    """Where labels are unsure: the scene from above and over two corners, things with their numbers."""
    given_base: str = ""
    """Id of the instance that the person has pointed at; empty: the prompt says which."""


@dataclass(frozen=True, slots=True)
class PoseView:
    """A way to rest: an orientation before any turn about the vertical."""

    id: str
    """upright (as in the file), flip_x, flip_y, flip_z, on_left_side ..., righted (as its shape says), stable_0 ..."""
    rotation: tuple[Vector, Vector, Vector]
    """Rows of the rotation from the mesh frame to the world."""
    probability: float
    """Share of directions from which it comes to rest like that; 0 where it is no stable pose."""
    up: Vector
    """Where what is up of the standing thing points in the world: the mesh's z axis, or the righted one's."""
    front: Vector
    """Where its front points in the world, as found in the frame in which that is up."""
    size: Vector
    """Extents along world x, y, z in that pose [m]."""
    words: str = ""
    """How it lies, in words."""

    @classmethod
    def of(cls, name: str, rotation: Floats, probability: float, up: Floats, front: Floats, size: Floats) -> "PoseView":
        """From arrays of shape (3, 3) and (3,)."""
        rows = (vector(rotation[0]), vector(rotation[1]), vector(rotation[2]))
        described = vector(up), vector(front), vector(size), pose_in_words(up, front)
        return cls(name, rows, round(probability, 6), *described)


def pose_in_words(up: Floats, front: Floats) -> str:
    """Describe how a thing lies, by the directions of its own top and front, unit vectors (3,)."""
    ways = {
        "stands, its own top up": up[2], "upside down, its own top down": -up[2],
        "on its back, its front up": front[2], "on its face, its front down": -front[2],
        "on its right side": np.cross(up, front)[2], "on its left side": -np.cross(up, front)[2],
    }  # fmt: skip
    best = max(ways, key=lambda way: float(ways[way]))
    return best if ways[best] > LEVEL else f"slanting, nearly {best}"


@dataclass(frozen=True, slots=True)
class FacingView:
    """Something that the front may look at, with the turn that achieves it."""

    id: str
    """`keep`, `aligned`, an instance id, `part:NAME`, `wall`, `viewer` ..."""
    direction: Vector
    """Horizontal unit vector from the target place towards it."""


@dataclass(frozen=True, slots=True)
class RotationRequest:
    """Which rotation."""

    prompt: str
    """Refined: what is placed where, and what was said about orientation."""
    object_name: str
    pose: str
    """Pose that the prompt asks for: upright, upside_down ... or any."""
    facing: str
    """Target that the prompt says the front shall look at; empty: nothing."""
    poses: tuple[PoseView, ...]
    facings: tuple[FacingView, ...]
    symmetry: int
    """Order of the rotational symmetry about its upright axis; 0: any angle, 1: none."""
    has_front: bool
    """Whether shape or category tell front from back."""
    pictures: tuple[Picture, ...] = field(default=(), compare=False)
    """The flips about x, y, z; of an ablation each of them from four sides."""
    stands: bool = True
    """Whether it would stand on a plane as it is in its file."""
    righting: float = 0.0
    """How much more the shape speaks for `righted` than for `upright`: from 0.5 clearly; 0 where it is not listed."""
    turn_deg: float = 0.0
    """Turn about the vertical that the prompt asks for, counterclockwise seen from above [degrees]."""
    on_legs: bool = False
    """Whether it has more air than body under its middle: on four legs its back is its top."""


@dataclass(frozen=True, slots=True)
class BoxView:
    """A box as seen by who looks at the base's front."""

    id: str
    """A part's index, an instance's id or `part:NAME`."""
    label: str
    center: Vector
    """To the right, to the front and up from the middle of the base's box [m]."""
    size: Vector
    """Extents along right, front and up [m]."""


@dataclass(frozen=True, slots=True)
class AnchorRequest:
    """Which part and where on it."""

    prompt: str
    """The whole sentence."""
    region_words: str
    """Those of its words that were read as the place."""
    object_name: str
    footprint: tuple[float, float]
    """Horizontal extents of the object in its pre-drop orientation [m]."""
    base_label: str
    parts: tuple[PartView, ...]
    asked_part: str
    asked_which: str
    asked_regions: tuple[str, ...]
    asked_references: tuple[str, ...]
    right: Vector
    """Unit vector to the right of a viewer who looks at the base's front."""
    front: Vector
    """Unit vector from the base towards that viewer."""
    asked_constraints: tuple[RegionConstraint, ...] = ()
    """Excluded places and distances; the stage keeps them whatever is answered."""
    part_boxes: tuple[BoxView, ...] = ()
    """Of all parts, in the order of `parts`."""
    references: tuple[BoxView, ...] = ()
    """Of what `asked_references` name; several where a thing has several pieces."""
    neighbours: tuple[BoxView, ...] = ()
    """Of what stands or hangs on, over and next to the base."""
    pictures: tuple[Picture, ...] = field(default=(), compare=False)
    """One: the base from above, the viewer's side at the bottom."""


@dataclass(frozen=True, slots=True)
class MaterialQuestion:
    """One part whose material is asked."""

    body: str
    """`object` or an instance id."""
    label: str
    """Label of the whole."""
    part: PartView


@dataclass(frozen=True, slots=True)
class MaterialsRequest:
    """Which row of the library for each part."""

    prompt: str
    questions: tuple[MaterialQuestion, ...]
    library: tuple[Material, ...]
    base_id: str = ""
    """The instance that carries the object: what the prompt says of such a thing, it says of this one."""
    pictures: tuple[Picture, ...] = field(default=(), compare=False)


@dataclass(frozen=True, slots=True)
class LabelRequest:
    """Question about the label of a thing found in a room without annotations."""

    id: str
    size: Vector
    """Longer and shorter horizontal side and height of its smallest upright box [m]."""
    bottom: float
    """Height above the floor [m]."""
    top: float
    """Height above the floor [m]."""
    level_height: float | None
    """Height of its main upward surface above the floor [m]; None where nothing looks up."""
    level_area: float | None
    """[m^2]; None, as `rise`, where a scan has not seen the top."""
    rise: float | None
    """How far it rises above that surface [m]."""
    levels: int
    """Upward surfaces that cover a good part of its plan: boards of a shelf."""
    closed: float | None
    """Share of its outline seen from the side that is filled, 0..1; None, as others, where a scan shows too little."""
    covered: float
    """Share of the rectangle around it, seen from above, that is filled, 0..1."""
    waist: float | None
    """Breadth where it is narrowest over where it is widest, 0..1."""
    rough: float | None
    """0: smooth, 0.1 and more: leaves, folds."""
    held_by: str
    """floor, wall, ceiling, nothing, or the id of the thing that carries it."""
    holder: str
    """The same, with the label of that thing instead of its id."""
    wall_gap: float | None
    """Distance to the nearest wall [m]; None without walls."""
    carries: int
    """How many things stand on it."""
    color: Vector
    """Mean sRGB colour, 0..1."""
    varied: float
    """Distance from its mean colour that a twentieth of its surface exceeds [CIELAB units]."""
    balance: float | None
    """Height of the middle of its surface within its box: 0 at the bottom, 1 at the top."""
    labels: tuple[str, ...]
    """Labels that it may have, besides `other`."""
    pictures: tuple[Picture, ...] = field(default=(), compare=False)
    """The room with the thing in a loud colour, and the thing from near."""

    @property
    def thickness(self) -> float:
        """Along the thinnest axis of its box [m]."""
        return min(self.size)


@dataclass(frozen=True, slots=True)
class ProposedPart:
    """A part as geometry found and named it."""

    part: PartView
    confidence: float
    """0..1, how well the rule that named it fits."""
    paint: Vector
    """Its colour in the picture, sRGB 0..1."""


@dataclass(frozen=True, slots=True)
class PartsRequest:
    """Question about the names of the parts of one instance."""

    id: str
    label: str
    """Label of the whole."""
    parts: tuple[ProposedPart, ...]
    names: tuple[str, ...]
    """Names that a part may have; the proposed names are among them."""
    pictures: tuple[Picture, ...] = field(default=(), compare=False)
    """The instance alone, each part in its paint and with its index."""
