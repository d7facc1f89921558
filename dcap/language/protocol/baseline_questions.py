"""Questions of the baselines: one line of a layout (LayoutGPT), the support and relations of a thing (Holodeck).

Both see the instances that our own method's intent sees, with the same ids, labels and boxes, and the whole sentence.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

from pydantic import BaseModel, Field

from dcap.language.protocol.requests import InstanceView, ObjectView, Vector

LONGEST_LAYOUT = 20_000
"""Characters of a written layout [-]."""


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
