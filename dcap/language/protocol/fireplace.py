"""Questions of the FirePlace* baseline: constraint outlines, choices among a few options, and pruning of placements.

The three questions of a placement by constraints between surfaces: the sentence as outlines of binary constraints, the
choice among several things, surfaces or placements (asked in small batches), and the placements that common sense rules
out. As everywhere, the program computes geometry and the client chooses among listed options.
"""

from dataclasses import dataclass, field
from typing import Literal

from pydantic import BaseModel, Field

from dcap.language.protocol.questions import Question
from dcap.language.protocol.requests import InstanceView, ObjectView, Picture, PoseView, Vector

ConstraintFunction = Literal["contact", "parallel", "no_overhang", "close_to", "far_from", "in_front_of", "facing"]
AnchorSide = Literal["top", "bottom", "left", "right", "front", "back", "whole"]
ChoiceKind = Literal["thing", "object_surface", "anchor_surface", "placement"]
DISTANCED = frozenset({"close_to", "far_from"})
"""Functions that need a distance."""
MOST_OUTLINES = 24
"""Maximum number of constraints of one sentence [-]."""
SIDES = ("front", "back", "left", "right", "top", "bottom")


@dataclass(frozen=True, slots=True)
class OutlinesRequest:
    """Question about the constraints between surfaces of the object and of things in the scene that the sentence
    states."""

    prompt: str
    object_name: str
    item: ObjectView
    instances: tuple[InstanceView, ...]
    """The instances, as in the question about the support of a placement."""
    fronts: tuple[Vector, ...]
    """For each instance the horizontal unit vector towards the viewer of its front, who defines left and right."""
    room_center: Vector
    """Middle of the scene [m]."""
    object_surfaces: tuple[PoseView, ...]
    """Surfaces on which the object may rest, each as the pose in which it faces down."""
    symmetry: int
    """Order of the object's rotational symmetry about its upright axis; 0: any angle, 1: none."""
    has_front: bool
    """Whether shape or category distinguish front and back."""
    stands: bool
    """Whether it would stand on a plane in its file's pose."""
    righting: float
    """Lead of `righted` over `upright` in the shape's score; 0 if it is not listed."""
    on_legs: bool
    """Whether it has more air than body under its middle."""
    pictures: tuple[Picture, ...] = field(default=(), compare=False)
    """The scene with numbered things, if its labels are uncertain."""


class ConstraintOutline(BaseModel, frozen=True, extra="forbid", allow_inf_nan=False):
    """One binary constraint between a surface of the object and a surface of a thing, before both are resolved."""

    function: ConstraintFunction
    object_surfaces: tuple[str, ...] = Field(
        description="contact: ids of the listed object surfaces that may be meant, likeliest first; "
        "else one of front, back, left, right, top, bottom"
    )
    anchors: tuple[str, ...] = Field(description="ids of the listed instances that may be meant, likeliest first")
    anchor_parts: tuple[int, ...] = Field(
        default=(), description="indices of the parts of the first anchor that are meant; empty: all of it"
    )
    anchor_side: AnchorSide = Field(description="side of the thing or part, as its viewer sees it; or the whole")
    metres: float | None = Field(default=None, ge=0, le=20, description="only of close_to and far_from [m]")
    share: float | None = Field(
        default=None,
        ge=0,
        le=1,
        description="instead of metres: distance from a side over the extent of the anchor across that side",
    )
    words: str = Field(default="", max_length=200, description="the words of the prompt that ask for it")

    def check(self, request: OutlinesRequest) -> None:
        """Raise ValueError if it refers to something that is not listed."""
        by_id = {one.id: one for one in request.instances}
        if not self.anchors or not self.object_surfaces:
            raise ValueError(f"constraint {self.function} names no anchor or no surface of the object")
        unlisted = [one for one in self.anchors if one not in by_id]
        if unlisted:
            raise ValueError(f"anchor {unlisted[0]!r} is not one of {', '.join(by_id)}")
        surfaces = tuple(one.id for one in request.object_surfaces) if self.function == "contact" else SIDES
        unknown = [one for one in self.object_surfaces if one not in surfaces]
        if unknown:
            raise ValueError(
                f"object surface {unknown[0]!r} of constraint {self.function} is not one of {', '.join(surfaces)}"
            )
        parts = {part.index for part in by_id[self.anchors[0]].parts}
        if not parts.issuperset(self.anchor_parts):
            raise ValueError(f"anchor_parts {list(self.anchor_parts)} are not all parts of {self.anchors[0]}")
        given = (self.metres is not None) + (self.share is not None)
        if given != (1 if self.function in DISTANCED else 0):
            raise ValueError(f"constraint {self.function} has {given} distances; only {sorted(DISTANCED)} have one")


class OutlinesReply(BaseModel, frozen=True, extra="forbid", allow_inf_nan=False):
    """All constraints that the sentence asks for, and those that go without saying."""

    reason: str = ""
    constraints: tuple[ConstraintOutline, ...] = Field(
        max_length=MOST_OUTLINES, description="exactly one contact among them; empty if the anchor is not there"
    )
    missing: str = Field(default="", description="what the prompt asks for and the scene does not have; else empty")
    did_you_mean: str = Field(default="", description="label of a listed instance that may be meant by what is missing")

    def check(self, request: OutlinesRequest) -> None:
        """Raise ValueError if it chooses something that is not listed, or no support."""
        if self.missing:
            return
        contacts = [one for one in self.constraints if one.function == "contact"]
        if len(contacts) != 1:
            raise ValueError(f"constraints hold {len(contacts)} contacts, expected exactly one")
        if contacts[0].anchor_side == "whole":
            raise ValueError("the contact's anchor_side is 'whole': contact is with one side of a thing")
        for one in self.constraints:
            one.check(request)


@dataclass(frozen=True, slots=True)
class ChoiceOption:
    """An option to choose; its picture is the one at the same position."""

    id: str
    """A letter without meaning."""
    label: str
    facts: tuple[tuple[str, float], ...]
    """Measures by name; lengths in metres."""

    def fact(self, name: str) -> float:
        """A measure; 0 if there is none of that name."""
        return dict(self.facts).get(name, 0.0)


@dataclass(frozen=True, slots=True)
class ChoiceRequest:
    """Question about the best option of a small batch for the sentence."""

    prompt: str
    kind: ChoiceKind
    sought: str
    """Requested thing, in words."""
    options: tuple[ChoiceOption, ...]
    pictures: tuple[Picture, ...] = field(default=(), compare=False)
    """A picture for each option, in their order."""


class ChoiceReply(BaseModel, frozen=True, extra="forbid"):
    """One of the options."""

    reason: str = ""
    chosen: str = Field(description="id of the option that fits best")

    def check(self, request: ChoiceRequest) -> None:
        """Raise ValueError if it is not among them."""
        known = [one.id for one in request.options]
        if self.chosen not in known:
            raise ValueError(f"chosen {self.chosen!r} is not one of {', '.join(known)}")


@dataclass(frozen=True, slots=True)
class PruningRequest:
    """Question about the placements that contradict common sense."""

    prompt: str
    object_name: str
    options: tuple[ChoiceOption, ...]
    pictures: tuple[Picture, ...] = field(default=(), compare=False)
    """A picture for each placement, in their order."""


class PruningReply(BaseModel, frozen=True, extra="forbid"):
    """The placements that are left out."""

    reason: str = ""
    implausible: tuple[str, ...] = Field(default=(), description="ids of placements that common sense rules out")

    def check(self, request: PruningRequest) -> None:
        """Raise ValueError if one is not among them."""
        known = [one.id for one in request.options]
        unlisted = [one for one in self.implausible if one not in known]
        if unlisted:
            raise ValueError(f"implausible {unlisted[0]!r} is not one of {', '.join(known)}")


OUTLINES = Question("fireplace_outlines", OutlinesRequest, OutlinesReply, OutlinesReply.check, ("instances", "fronts"))
CHOICE = Question("fireplace_choice", ChoiceRequest, ChoiceReply, ChoiceReply.check)
PRUNING = Question("fireplace_pruning", PruningRequest, PruningReply, PruningReply.check)
