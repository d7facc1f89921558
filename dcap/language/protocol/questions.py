"""The questions that stages ask, six of our own method and those of the baselines.

Each says which request and which reply it takes, and how one is checked against the other. A stage says
`client.ask(INTENT, request)` and gets an `IntentReply`; it never learns who answered.

Questions of the baselines: one line of a layout (LayoutGPT), the support and relations of a thing (Holodeck).

Both see the instances that our own method's intent sees, with the same ids, labels and boxes, and the whole sentence.

A line of a layout as LayoutGPT writes them: `bed {length: 120px; width: 110px; height: 60px; ... depth: 30px;}`.

The source is the published program of LayoutGPT (Feng et al., 2023; `parse_3D_layout`): what stands before the bracket
is the category without its digits, between the brackets are exactly seven fields `name: number`, letters of units are
cut off, and whatever is not of this form is no line. A line whose seven fields have other names is none either; the
source keeps it as a box of zeros.
"""

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Generic, TypeVar

from pydantic import BaseModel, Field

from dcap.language.protocol.replies import (
    AnchorReply,
    IntentReply,
    LabelReply,
    MaterialsReply,
    PartsReply,
    RotationReply,
)
from dcap.language.protocol.requests import (
    AnchorRequest,
    InstanceView,
    IntentRequest,
    LabelRequest,
    MaterialsRequest,
    ObjectView,
    PartsRequest,
    RotationRequest,
    Vector,
)

LONGEST_LAYOUT = 20_000
"""Characters of a written layout [-]."""
RequestT = TypeVar("RequestT")
ReplyT = TypeVar("ReplyT", bound=BaseModel)
FIELDS = ("length", "width", "height", "left", "top", "depth", "orientation")
"""Seven numbers: extents, then the middle of the box from the plan's least corner, then the turn about the vertical."""
ANGLE = "orientation"
NUMBER = re.compile(r"^\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)(?:\s*[px]+)?(?:\s*[degrs]+)?\s*$")
"""The source cuts any letters of `degrees` off the end, then any of `px`: `90`, `90deg` and `90 degree` are valid."""


@dataclass(frozen=True, slots=True)
class LayoutLine:
    """A line of the room's layout."""

    thing: str
    """Id of the listed instance."""
    part: int
    """Index of its part, -1 for the whole instance."""
    text: str
    """`bed {length: 120px; ...}`."""


@dataclass(frozen=True, slots=True)
class LayoutRequest:
    """One new line for a layout."""

    prompt: str
    item: ObjectView
    instances: tuple[InstanceView, ...]
    room_center: Vector
    """Middle of the scene [m]."""
    categories: str
    """Things that such rooms hold, with how often."""
    exemplars: tuple[str, ...]
    """Conditions and layouts of other rooms, the most similar first."""
    condition: str
    """Type and size of this room."""
    lines: tuple[LayoutLine, ...]
    """The room's layout so far."""
    category: str
    """Category that the new line begins with."""
    asset: tuple[int, int, int]
    """Length, width and height of what is placed [pixels]."""
    asset_size: Vector
    """The same [m]."""
    has_front: bool
    """Whether it has a front."""
    origin: Vector
    """World point of left 0, top 0, depth 0 [m]."""
    pixels_per_metre: float


class LayoutReply(BaseModel, frozen=True, extra="forbid"):
    """Line that the layout gains."""

    layout: str = Field(max_length=LONGEST_LAYOUT, description="the new line of the layout, in CSS style")

    def check(self, request: LayoutRequest) -> None:
        """Any text is an answer: what is no line is dropped by who reads it, as in the source."""


@dataclass(frozen=True, slots=True)
class NamedThing:
    """An instance under the name by which relations speak of it."""

    name: str
    """`bed-0`."""
    id: str
    """Id of the listed instance."""


@dataclass(frozen=True, slots=True)
class RelationsRequest:
    """Question about the support of a thing and its relations to others."""

    prompt: str
    item: ObjectView
    instances: tuple[InstanceView, ...]
    room_center: Vector
    """Middle of the scene [m]."""
    room_type: str
    room_size_cm: tuple[int, int]
    object_name: str
    """The name of what is placed: `ball-0`."""
    object_size_cm: tuple[int, int, int]
    things: tuple[NamedThing, ...] = field(default=())
    """Things that can be named."""


class RelationsReply(BaseModel, frozen=True, extra="forbid"):
    """A receptacle and a line of relations."""

    on_top_of: str = Field(
        default="", description="name of the listed thing that the object is put on or in; empty: it goes on the floor"
    )
    constraints: str = Field(
        default="", max_length=2000, description="object | global constraint | constraint, target | ..."
    )

    def check(self, request: RelationsRequest) -> None:
        """ValueError if the receptacle is not listed."""
        names = [one.name for one in request.things]
        if self.on_top_of and self.on_top_of not in names:
            raise ValueError(f"on_top_of {self.on_top_of!r} is not one of {', '.join(names)}")


def names_of(instances: Sequence[InstanceView]) -> tuple[NamedThing, ...]:
    """A name for every instance: its label and a count."""
    counts: dict[str, int] = {}
    named = []
    for one in instances:
        label = one.label.lower().replace("|", " ").replace(",", " ").strip()
        number = counts.get(label, 0)
        counts[label] = number + 1
        named.append(NamedThing(f"{label}-{number}", one.id))
    return tuple(named)


@dataclass(frozen=True, slots=True)
class Question(Generic[RequestT, ReplyT]):
    """A kind of question."""

    name: str
    """Also the name of its template: `prompts/NAME.system.j2`."""
    request: type[RequestT]
    reply: type[ReplyT]
    check: Callable[[ReplyT, RequestT], None]
    """Raises ValueError, with a sentence that a model can be shown, if the reply chooses what is not listed."""
    shared: tuple[str, ...] = ()
    """Fields of the request that many questions of a run have in common: sent first, so that they can be cached."""
    unseen: tuple[str, ...] = ()
    """Fields of the request that no model is shown: what only the stand-in answers from."""
    stand_in: Callable[[RequestT], ReplyT] | None = None
    """The function that answers offline, where that is not the reader of sentences."""

    def parsed(self, answer: object, request: RequestT) -> ReplyT:
        """An answer as a reply that fits the request; ValueError otherwise."""
        reply = self.reply.model_validate(answer)
        self.check(reply, request)
        return reply


INTENT = Question("intent", IntentRequest, IntentReply, IntentReply.check, ("instances", "room_center"))
ROTATION = Question("rotation", RotationRequest, RotationReply, RotationReply.check)
ANCHOR = Question("anchor", AnchorRequest, AnchorReply, AnchorReply.check)
MATERIALS = Question("materials", MaterialsRequest, MaterialsReply, MaterialsReply.check)
LABEL = Question("label", LabelRequest, LabelReply, LabelReply.check, ("labels",))
PARTS = Question("parts", PartsRequest, PartsReply, PartsReply.check, ("names",))
LAYOUTGPT = Question("layoutgpt", LayoutRequest, LayoutReply, LayoutReply.check, ("instances", "room_center"))
HOLODECK = Question("holodeck", RelationsRequest, RelationsReply, RelationsReply.check, ("instances", "room_center"))


@dataclass(frozen=True, slots=True)
class CssBox:
    """A box of a layout, in pixels and degrees."""

    category: str
    length: float
    """To its right at orientation 0, along x."""
    width: float
    """To its front at orientation 0, along y."""
    height: float
    left: float
    """Middle along x from the plan's least x."""
    top: float
    """Middle along y from the plan's least y."""
    depth: float
    """Middle above the floor."""
    orientation: float
    """Turn about the vertical, counterclockwise seen from above [degrees]."""

    @property
    def text(self) -> str:
        """The line."""
        fields = (
            f"{name}: {getattr(self, name):g} degrees" if name == ANGLE else f"{name}: {getattr(self, name):g}px"
            for name in FIELDS
        )
        return f"{self.category} {{{'; '.join(fields)};}}"


def parsed_line(text: str) -> CssBox | None:
    """The box of a line; None of what is no line."""
    before, bracket, rest = text.partition("{")
    if not bracket or "{" in rest:
        return None
    fields = rest.strip().strip("}").strip().strip(";").split(";")
    numbers = {}
    for entry in fields:
        name, colon, value = entry.partition(":")
        found = NUMBER.match(value)
        if not colon or found is None or not math.isfinite(float(found[1])):
            return None
        numbers[name.strip()] = float(found[1])
    if len(fields) != len(FIELDS) or sorted(numbers) != sorted(FIELDS):
        return None
    return CssBox(re.sub(r"\d", "", before).strip(), **numbers)


def parsed_layout(text: str) -> list[CssBox]:
    """The boxes of a text, line by line; other lines are dropped."""
    found = (parsed_line(line) for line in text.splitlines())
    return [box for box in found if box is not None]
