"""The questions that stages ask, six of our own method and those of the baselines.

Each question states its types of request and reply, and checks one against the other. A stage calls `client.ask(INTENT,
request)` and gets an `IntentReply`; it never learns who answered.

Questions of the baselines: one line of a layout (LayoutGPT), the support and relations of a thing (Holodeck).

Both see the instances of our own method's intent, with the same ids, labels and boxes, and the whole sentence.

A line of a layout in LayoutGPT's form: `bed {length: 120px; width: 110px; height: 60px; ... depth: 30px;}`.

The source is the published program of LayoutGPT (Feng et al., 2023; `parse_3D_layout`): the text before the bracket is
the category without its digits, between the brackets are exactly seven fields `name: number`, letters of units are cut
off, and text of any other form is not a line. A line whose seven fields have other names is not one either; the source
keeps it as a box of zeros.
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
"""Maximum length of a written layout [characters]."""
RequestT = TypeVar("RequestT")
ReplyT = TypeVar("ReplyT", bound=BaseModel)
FIELDS = ("length", "width", "height", "left", "top", "depth", "orientation")
"""Seven numbers: extents, then the middle of the box relative to the plan's lowest corner, then the turn about the
vertical."""
ANGLE = "orientation"
NUMBER = re.compile(r"^\s*([-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?)(?:\s*[px]+)?(?:\s*[degrs]+)?\s*$")
"""Pattern of a number with a unit; the source cuts any letters of `degrees` off the end, then any of `px`: `90`,
`90deg` and `90 degree` are valid."""


@dataclass(frozen=True, slots=True)
class LayoutLine:
    """A line of the room's layout."""

    thing: str
    """Id of the listed instance."""
    part: int
    """Index of the part, -1 for the whole instance."""
    text: str
    """Text of the line: `bed {length: 120px; ...}`."""


@dataclass(frozen=True, slots=True)
class LayoutRequest:
    """Question about one new line for a layout."""

    prompt: str
    item: ObjectView
    instances: tuple[InstanceView, ...]
    room_center: Vector
    """Middle of the scene [m]."""
    categories: str
    """Things that occur in such rooms, with their frequencies."""
    exemplars: tuple[str, ...]
    """Conditions and layouts of other rooms, the most similar first."""
    condition: str
    """Type and size of this room."""
    lines: tuple[LayoutLine, ...]
    """The room's layout so far."""
    category: str
    """Category with which the new line begins."""
    asset: tuple[int, int, int]
    """Length, width and height of the placed thing [pixels]."""
    asset_size: Vector
    """The same extents [m]."""
    has_front: bool
    """Whether the thing has a front."""
    origin: Vector
    """World point of left 0, top 0, depth 0 [m]."""
    pixels_per_metre: float


class LayoutReply(BaseModel, frozen=True, extra="forbid"):
    """Line that the layout gains."""

    layout: str = Field(max_length=LONGEST_LAYOUT, description="the new line of the layout, in CSS style")

    def check(self, request: LayoutRequest) -> None:
        """Any text is an answer: a text that is not a line is dropped by the reader, as in the source."""


@dataclass(frozen=True, slots=True)
class NamedThing:
    """An instance with its name in relations."""

    name: str
    """Name, such as `bed-0`."""
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
    """Name of the placed thing: `ball-0`."""
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
        """Raise ValueError if the receptacle is not listed."""
        names = [one.name for one in request.things]
        if self.on_top_of and self.on_top_of not in names:
            raise ValueError(f"on_top_of {self.on_top_of!r} is not one of {', '.join(names)}")


def names_of(instances: Sequence[InstanceView]) -> tuple[NamedThing, ...]:
    """A name for every instance: its label and a counter."""
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
    """Name of the question and of its template: `prompts/NAME.system.j2`."""
    request: type[RequestT]
    reply: type[ReplyT]
    check: Callable[[ReplyT, RequestT], None]
    """Raises ValueError with a sentence for the model if the reply chooses something that is not listed."""
    shared: tuple[str, ...] = ()
    """Fields of the request shared by many questions of a run: sent first, so that they can be cached."""
    unseen: tuple[str, ...] = ()
    """Fields of the request that are not shown to a model and are only used by the stand-in."""
    stand_in: Callable[[RequestT], ReplyT] | None = None
    """The function that answers offline, if that is not the reader of sentences."""

    def parsed(self, answer: object, request: RequestT) -> ReplyT:
        """An answer as a reply that fits the request; raises ValueError otherwise."""
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
    """Extent to the right at orientation 0, along x."""
    width: float
    """Extent to the front at orientation 0, along y."""
    height: float
    left: float
    """Middle along x, from the plan's minimum x."""
    top: float
    """Middle along y, from the plan's minimum y."""
    depth: float
    """Middle above the floor."""
    orientation: float
    """Turn about the vertical, counterclockwise seen from above [degrees]."""

    @property
    def text(self) -> str:
        """The line as text."""
        fields = (
            f"{name}: {getattr(self, name):g} degrees" if name == ANGLE else f"{name}: {getattr(self, name):g}px"
            for name in FIELDS
        )
        return f"{self.category} {{{'; '.join(fields)};}}"


def parsed_line(text: str) -> CssBox | None:
    """The box of a line; None for any other text."""
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
