"""Requests to a client: all information that a client may need to choose, as plain values and pictures made on demand.

Geometry is computed by the stages; a request lists the choices by id, and a reply can only select among them. All
lengths in metres, world frame, z up. Text from files or prompts is data for the clients, never an instruction.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from dcap.knowledge.shapes import colour_measures, share_of
from dcap.scene.types.choices import RegionConstraint
from dcap.scene.types.materials import Material

Floats = NDArray[np.floating]
Vector = tuple[float, float, float]
PART_SIDES = ("left", "right", "front", "back", "top", "bottom")
"""Sides by which a reference `part:NAME/SIDE` selects among several parts with the same name."""
LEVEL = 0.94
"""Cosine of the angle to the vertical above which a thing counts as slanted: 20 degrees."""
PictureMaker = Callable[[], NDArray[np.uint8]]
"""Makes an RGB picture, shape (h, w, 3); only called by clients that use pictures."""


@dataclass(frozen=True, slots=True)
class Picture:
    """A picture, and its description for a model."""

    name: str
    """Our own words, never those of a file or a person: a model reads them as ours."""
    make: PictureMaker


def vector(values: Floats) -> Vector:
    """Three floats of an array, shape (3,)."""
    x, y, z = (float(v) for v in values)
    return x, y, z


@dataclass(frozen=True, slots=True)
class PartView:
    """A part in the view of a client."""

    index: int
    name: str
    center: Vector
    """Centre [m]."""
    size: Vector
    """Extents along its box axes [m]."""
    support_area: float = 0.0
    """Upward-facing area [m^2]."""
    color: Vector = (0.5, 0.5, 0.5)
    """Mean sRGB colour, 0..1."""


@dataclass(frozen=True, slots=True)
class InstanceView:
    """An instance in the view of a client."""

    id: str
    label: str
    center: Vector
    size: Vector
    """Extents along its box axes [m]."""
    low: Vector
    """Lowest corner of the axis-aligned bounds of its box [m]."""
    high: Vector
    """Highest corner of the same bounds [m]."""
    front: Vector | None
    """Unit vector out of its front."""
    structure: bool
    color: Vector
    """Mean sRGB colour, 0..1."""
    parts: tuple[PartView, ...]
    guesses: tuple[tuple[str, float], ...] = ()
    """Possible labels and their probabilities, the likeliest first; empty if the source names the thing."""
    confidence: float = 1.0
    """Confidence of the label, 0..1."""
    number: int = 0
    """Number in the pictures; 0 if it has none."""


@dataclass(frozen=True, slots=True)
class ObjectView:
    """The object to place."""

    label: str
    size: Vector
    """Extents of the mesh as read, largest first [m]."""
    parts: tuple[PartView, ...]


@dataclass(frozen=True, slots=True)
class IntentRequest:
    """Question about the instance, size and mass, and about orientation and region in the prompt."""

    prompt: str
    item: ObjectView
    instances: tuple[InstanceView, ...]
    room_center: Vector
    """Middle of the scene [m]."""
    pictures: tuple[Picture, ...] = field(default=(), compare=False)
    """If labels are uncertain: the scene from above and over two corners, with numbered things."""
    given_base: str = ""
    """Id of the instance that the person has pointed at; empty: the prompt determines it."""


@dataclass(frozen=True, slots=True)
class PoseView:
    """A rest pose: an orientation before any turn about the vertical."""

    id: str
    """upright (as in the file), flip_x, flip_y, flip_z, on_left_side ..., righted (according to its shape), stable_0
    ..."""
    rotation: tuple[Vector, Vector, Vector]
    """Rows of the rotation from the mesh frame to the world."""
    probability: float
    """Share of directions from which it comes to rest in this pose; 0 if it is not stable."""
    up: Vector
    """World direction of the upward axis of the standing thing: the mesh's z axis, or the righted one's."""
    front: Vector
    """World direction of its front, as found in the frame with that upward axis."""
    size: Vector
    """Extents along world x, y, z in that pose [m]."""
    words: str = ""
    """The pose in words."""

    @classmethod
    def of(cls, name: str, rotation: Floats, probability: float, up: Floats, front: Floats, size: Floats) -> "PoseView":
        """The view from arrays of shape (3, 3) and (3,)."""
        rows = (vector(rotation[0]), vector(rotation[1]), vector(rotation[2]))
        described = vector(up), vector(front), vector(size), pose_in_words(up, front)
        return cls(name, rows, round(probability, 6), *described)


def pose_in_words(up: Floats, front: Floats) -> str:
    """Describe the pose of a thing from the directions of its top and front, unit vectors (3,)."""
    ways = {
        "stands, its own top up": up[2], "upside down, its own top down": -up[2],
        "on its back, its front up": front[2], "on its face, its front down": -front[2],
        "on its right side": np.cross(up, front)[2], "on its left side": -np.cross(up, front)[2],
    }  # fmt: skip
    best = max(ways, key=lambda way: float(ways[way]))
    return best if ways[best] > LEVEL else f"slanting, nearly {best}"


@dataclass(frozen=True, slots=True)
class FacingView:
    """A target that the front may face, with the necessary turn."""

    id: str
    """`keep`, `aligned`, an instance id, `part:NAME`, `wall`, `viewer` ..."""
    direction: Vector
    """Horizontal unit vector from the intended place towards it."""


@dataclass(frozen=True, slots=True)
class RotationRequest:
    """Question about the rotation."""

    prompt: str
    """Refined prompt: the object, its place, and the requested orientation."""
    object_name: str
    pose: str
    """Pose that the prompt requests: upright, upside_down ... or any."""
    facing: str
    """Target that the front should face according to the prompt; empty: none."""
    poses: tuple[PoseView, ...]
    facings: tuple[FacingView, ...]
    symmetry: int
    """Order of the rotational symmetry about the upright axis; 0: any angle, 1: none."""
    has_front: bool
    """Whether shape or category distinguish front and back."""
    pictures: tuple[Picture, ...] = field(default=(), compare=False)
    """The flips about x, y, z; in an ablation each of them from four sides."""
    stands: bool = True
    """Whether it would stand on a plane in its file's pose."""
    righting: float = 0.0
    """Lead of `righted` over `upright` in the shape's score: clear from 0.5; 0 if it is not listed."""
    turn_deg: float = 0.0
    """Turn about the vertical that the prompt requests, counterclockwise seen from above [degrees]."""
    on_legs: bool = False
    """Whether it has more air than body under its middle: on four legs its back is its top."""


@dataclass(frozen=True, slots=True)
class BoxView:
    """A box as seen by a viewer of the base's front."""

    id: str
    """A part's index, an instance's id or `part:NAME`."""
    label: str
    center: Vector
    """Centre relative to the middle of the base's box, to the right, to the front and up [m]."""
    size: Vector
    """Extents along right, front and up [m]."""


@dataclass(frozen=True, slots=True)
class AnchorRequest:
    """Question about the part and the place on it."""

    prompt: str
    """The whole sentence."""
    region_words: str
    """The words of the prompt that state the place."""
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
    """Excluded places and distances; the stage applies them whatever the answer."""
    part_boxes: tuple[BoxView, ...] = ()
    """Boxes of all parts, in the order of `parts`."""
    references: tuple[BoxView, ...] = ()
    """Boxes of `asked_references`; several for a thing of several pieces."""
    neighbours: tuple[BoxView, ...] = ()
    """Boxes of things that stand or hang on, over and next to the base."""
    pictures: tuple[Picture, ...] = field(default=(), compare=False)
    """A single picture: the base from above, the viewer's side at the bottom."""


@dataclass(frozen=True, slots=True)
class MaterialQuestion:
    """One part in the question about materials."""

    body: str
    """`object` or an instance id."""
    label: str
    """Label of the whole."""
    part: PartView


@dataclass(frozen=True, slots=True)
class MaterialsRequest:
    """Question about the row of the library for each part."""

    prompt: str
    questions: tuple[MaterialQuestion, ...]
    library: tuple[Material, ...]
    base_id: str = ""
    """The instance that carries the object, to which the prompt's words about such a thing apply."""
    pictures: tuple[Picture, ...] = field(default=(), compare=False)


@dataclass(frozen=True, slots=True)
class LabelRequest:
    """Question about the label of a thing found in a room without annotations."""

    id: str
    size: Vector
    """Longer and shorter horizontal side and height of its smallest upright box [m]."""
    bottom: float
    """Height of its bottom above the floor [m]."""
    top: float
    """Height of its top above the floor [m]."""
    level_height: float | None
    """Height of its main upward surface above the floor [m]; None if there is no upward surface."""
    level_area: float | None
    """Area of that surface [m^2]; None, like `rise`, if a scan has not seen the top."""
    rise: float | None
    """Height by which it rises above that surface [m]."""
    levels: int
    """Number of upward surfaces that cover a good part of its plan: boards of a shelf."""
    closed: float | None
    """Filled share of its outline seen from the side, 0..1; None, like others, if a scan shows too little."""
    covered: float
    """Filled share of the rectangle around it, seen from above, 0..1."""
    waist: float | None
    """Ratio of its smallest to its largest breadth, 0..1."""
    rough: float | None
    """Roughness; 0: smooth, 0.1 and more: leaves, folds."""
    held_by: str
    """Holder: floor, wall, ceiling, nothing, or the id of the thing that carries it."""
    holder: str
    """The same holder, with the label of the thing instead of its id."""
    wall_gap: float | None
    """Distance to the nearest wall [m]; None without walls."""
    carries: int
    """Number of things that stand on it."""
    color: Vector
    """Mean sRGB colour, 0..1."""
    varied: float
    """Distance from its mean colour that is exceeded by a twentieth of its surface [CIELAB units]."""
    balance: float | None
    """Height of the middle of its surface within its box: 0 at the bottom, 1 at the top."""
    labels: tuple[str, ...]
    """Possible labels, besides `other`."""
    pictures: tuple[Picture, ...] = field(default=(), compare=False)
    """The room with the thing in a loud colour, and the thing in close-up."""

    @property
    def thickness(self) -> float:
        """Thickness along the thinnest axis of its box [m]."""
        return min(self.size)

    def measures(self) -> dict[str, float]:
        """The numbers under the names of the table of usual shapes; unmeasured values are left out."""
        length, width, height = (max(size, 1e-3) for size in self.size)
        found = {
            "length": math.log(length), "width": math.log(width), "height": math.log(height), "bottom": self.bottom,
            "level": self.level_height, "rise": self.rise, "levels": float(self.levels),
            "closed": self.closed, "covered": self.covered, "waist": self.waist, "rough": self.rough,
            "gap": self.wall_gap, "varied": self.varied, "share": share_of(self.level_area, length * width),
            "balance": self.balance, **colour_measures(self.color),
        }  # fmt: skip
        return {name: value for name, value in found.items() if value is not None}


@dataclass(frozen=True, slots=True)
class ProposedPart:
    """A part found and named by geometry."""

    part: PartView
    confidence: float
    """Fit of the rule that named it, 0..1."""
    paint: Vector
    """Colour of the part in the picture, sRGB 0..1."""


@dataclass(frozen=True, slots=True)
class PartsRequest:
    """Question about the names of the parts of one instance."""

    id: str
    label: str
    """Label of the whole."""
    parts: tuple[ProposedPart, ...]
    names: tuple[str, ...]
    """Possible names of a part, including the proposed names."""
    pictures: tuple[Picture, ...] = field(default=(), compare=False)
    """The instance alone, each part in its colour and with its index."""
