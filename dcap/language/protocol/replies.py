"""Replies of a client: validated types that choose only among the options listed in the request.

Pydantic checks shape and ranges; `check` compares a reply with its request and raises ValueError with one sentence that
can be shown to a model. A reply that fails is never used.
"""

import math
from collections.abc import Collection, Iterable
from typing import Annotated, Literal

from pydantic import BaseModel, Field, PositiveFloat, ValidatorFunctionWrapHandler, WrapValidator

from dcap.language.protocol.requests import (
    PART_SIDES,
    AnchorRequest,
    IntentRequest,
    LabelRequest,
    MaterialsRequest,
    PartsRequest,
    RotationRequest,
)
from dcap.scene.types.choices import RegionConstraint
from dcap.scene.types.outcome import Caution


def kept(value: object, check: ValidatorFunctionWrapHandler) -> str:
    """A caution, unchanged; pydantic would turn it into a plain text."""
    return value if isinstance(value, Caution) else str(check(value))


Message = Annotated[str, WrapValidator(kept)]
Pose = Literal[
    "upright", "seated", "upside_down", "on_side", "on_left_side", "on_right_side", "lying", "standing", "on_back",
    "on_front", "leaning", "any",
]  # fmt: skip
Region = Literal[
    "center", "left", "right", "front", "back", "head", "foot", "edge", "long", "corner", "end", "near", "next_to",
    "between", "middle", "under", "any",
]  # fmt: skip
ConstraintKind = Literal["not_on", "not_in", "exactly", "at_least", "at_most", "farthest", "nearest", "away"]
MEASURED = frozenset({"exactly", "at_least", "at_most"})
"""Kinds of constraints with a distance."""
SPECIAL_FACINGS = ("wall", "door", "viewer", "room", "left", "right", "front", "back")
Metres = PositiveFloat
LONGEST_NAME = 80
"""Maximum length of a thing's name [characters]."""
ROUNDED = 0.05
"""Tolerance of the length of a quaternion written by a model with few digits [-]."""
MOST_STATES = 3
"""Maximum number of sizes of one thing in addition to the usual one."""
OTHER = "other"
"""The label for a thing that fits none of the listed labels."""


class Candidate(BaseModel, frozen=True, extra="forbid", allow_inf_nan=False):
    """An instance that the prompt may mean."""

    id: str = Field(description="id of a listed instance")
    likelihood: float = Field(gt=0.0, le=1.0, description="how likely the prompt means this one")


class Constraint(BaseModel, frozen=True, extra="forbid", allow_inf_nan=False):
    """Constraint on the place in addition to its region."""

    kind: ConstraintKind = Field(
        description="not_on: neither on, over nor under the reference; not_in: not in the regions; exactly, at_least, "
        "at_most: so many metres of free gap; farthest, nearest, away: from the reference or the edge"
    )
    regions: tuple[Region, ...] = Field(
        default=(), description="of the part, or beside the reference; of a distance edge, corner or end with sides"
    )
    reference: str = Field(default="", description="listed instance id or part:NAME; empty: the part's own regions")
    metres: float = Field(default=0.0, ge=0, le=20, description="of exactly, at_least and at_most [m]; of others 0")
    words: str = Field(default="", max_length=200)

    def check(self, targets: Collection[str]) -> None:
        """Raise ValueError if it refers to something that is not listed, or is incomplete."""
        if self.reference and not listed(self.reference, targets):
            raise ValueError(f"reference {self.reference!r} of constraint {self.kind} is not listed")
        if not (self.reference or self.regions) or (self.kind == "not_on" and not self.reference):
            raise ValueError(f"constraint {self.kind} names neither a reference nor a region")
        if (self.metres > 0.0) != (self.kind in MEASURED):
            raise ValueError(
                f"constraint {self.kind} has metres {self.metres}; only exactly, at_least, at_most have some"
            )


def region_constraints(said: Iterable[Constraint]) -> tuple[RegionConstraint, ...]:
    """Constraints of a reply in the form that the stages use."""
    return tuple(RegionConstraint(one.kind, one.regions, one.reference, one.metres or None, one.words) for one in said)


def listed(reference: str, targets: Collection[str]) -> bool:
    """Return whether a reference, including `part:NAME/SIDE`, is one of the targets."""
    name, _, side = reference.partition("/") if reference.startswith("part:") else (reference, "", "")
    return name in targets and side in ("", *PART_SIDES)


class IntentReply(BaseModel, frozen=True, extra="forbid", allow_inf_nan=False):
    """Base, size, mass, orientation and region."""

    reason: str = Field(default="", description="how the prompt is understood, in two or three short sentences")
    candidates: tuple[Candidate, ...] = Field(
        default=(),
        description="every listed instance that the prompt may mean as the base, with how likely; base_id among them",
    )
    reference_candidates: tuple[Candidate, ...] = Field(
        default=(), description="the same for the thing that the first reference means, where several may be meant"
    )
    base_id: str = Field(description="id of the listed instance that shall carry the object; empty if it is not there")
    missing: str = Field(default="", description="what the prompt asks for and the scene does not have; else empty")
    did_you_mean: str = Field(default="", description="label of a listed instance that may be meant by what is missing")
    object_name: str = Field(
        min_length=1, max_length=LONGEST_NAME, description="category of the object, one to three words"
    )
    size: tuple[Metres, Metres, Metres] = Field(description="realistic extents of the object, largest first [m]")
    alternative_sizes: tuple[tuple[Metres, Metres, Metres], ...] = Field(
        default=(),
        description="extents of the same object in its other states, each largest first [m]: spread out where size is "
        "folded, laid out where it is rolled up, closed where it is open; empty if it has one state only",
    )
    spread: float = Field(default=1.4, ge=1.0, le=5.0, description="factor by which real ones are larger or smaller")
    mass: float = Field(gt=0, le=5000, description="realistic mass of the object [kg]")
    hollow: bool = Field(default=False, description="mass is not density times the volume of its closed mesh")
    pose: Pose = Field(
        default="any",
        description="orientation that the prompt asks for; upright: right way up, seated: as such a thing "
        "sits or usually rests, standing: on end, leaning: tilted against lean_on",
    )
    lean_on: str = Field(
        default="", description="listed instance id or part:NAME of the base that it leans on; only with pose leaning"
    )
    facing: str = Field(
        default="",
        description="listed instance id, part:NAME, wall, door, viewer, room or a side; away: before it for the "
        "opposite; empty if nothing is said",
    )
    turn_deg: float = Field(
        default=0.0,
        ge=-360,
        le=360,
        description="turn about the vertical that the prompt asks for, beyond the facing or the usual alignment, "
        "counterclockwise seen from above [degrees]; diagonally: 45; 0 if nothing is said",
    )
    orientation_words: str = ""
    part: str = Field(default="", description="name of a listed part of the base, empty if none is asked for")
    which: str = Field(
        default="",
        description="which of several parts of that name: left, right, top, bottom, middle, or a number counted from "
        "below",
    )
    regions: tuple[Region, ...] = ()
    references: tuple[str, ...] = Field(
        default=(),
        description="listed instance ids, or part:NAME of the base; of several, part:NAME/left, right, front, back, "
        "top or bottom",
    )
    constraints: tuple[Constraint, ...] = Field(
        default=(), description="excluded places, distances, farthest and nearest: what regions cannot say"
    )
    region_words: str = ""
    not_understood: tuple[str, ...] = ()
    notes: tuple[Message, ...] = ()

    def check(self, request: IntentRequest) -> None:
        """Raise ValueError if it chooses something that is not listed."""
        by_id = {instance.id: instance for instance in request.instances}
        if request.given_base and self.base_id != request.given_base:
            raise ValueError(f"base_id {self.base_id!r} is not {request.given_base!r}, which the person has pointed at")
        if not self.base_id:
            if not self.missing:
                raise ValueError("base_id is empty but missing does not say what the scene lacks")
            return
        if self.base_id not in by_id:
            raise ValueError(f"base_id {self.base_id!r} is not one of {', '.join(by_id)}")
        for size in (self.size, *self.alternative_sizes):
            if not 1e-3 <= max(size) <= 20:
                raise ValueError(f"size {size} is not between 1 mm and 20 m")
        if len(self.alternative_sizes) > MOST_STATES:
            raise ValueError(f"alternative_sizes has {len(self.alternative_sizes)} entries > {MOST_STATES}")
        parts = {part.name for part in by_id[self.base_id].parts}
        if self.part and self.part not in parts:
            raise ValueError(f"part {self.part!r} is not one of {', '.join(sorted(parts))}")
        targets = {*by_id, *(f"part:{name}" for name in parts)}
        for reference in self.references:
            if not listed(reference, targets):
                raise ValueError(f"reference {reference!r} is neither a listed instance nor a part of {self.base_id}")
        for constraint in self.constraints:
            constraint.check(targets)
        if bool(self.lean_on) != (self.pose == "leaning") or (self.lean_on and not listed(self.lean_on, targets)):
            raise ValueError(f"lean_on {self.lean_on!r} with pose {self.pose}: leaning needs a listed instance or part")
        unlisted = [one.id for one in (*self.candidates, *self.reference_candidates) if one.id not in by_id]
        if unlisted:
            raise ValueError(f"candidate {unlisted[0]!r} is not one of {', '.join(by_id)}")
        if self.candidates and self.base_id not in [one.id for one in self.candidates]:
            raise ValueError(f"base_id {self.base_id!r} is not among the candidates")
        facing = self.facing.removeprefix("away:")
        if facing and facing not in targets and facing not in SPECIAL_FACINGS:
            raise ValueError(f"facing {self.facing!r} is not listed")


class RotationReply(BaseModel, frozen=True, extra="forbid", allow_inf_nan=False):
    """One rotation: a listed pose turned about the vertical, or any rotation as a quaternion."""

    reason: str = ""
    pose_id: str = Field(description="id of a listed pose")
    facing_id: str = Field(default="aligned", description="id of a listed facing")
    turn_deg: float = Field(
        default=0.0,
        ge=-360,
        le=360,
        description="further turn about the vertical, counterclockwise seen from above [degrees]",
    )
    quaternion: tuple[float, float, float, float] | None = Field(
        default=None, description="w, x, y, z from the mesh frame to the world; replaces all of the above if given"
    )

    def check(self, request: RotationRequest) -> None:
        """Raise ValueError if it chooses something that is not listed."""
        poses = [pose.id for pose in request.poses]
        if self.pose_id not in poses:
            raise ValueError(f"pose_id {self.pose_id!r} is not one of {', '.join(poses)}")
        facings = [facing.id for facing in request.facings]
        if self.facing_id not in facings:
            raise ValueError(f"facing_id {self.facing_id!r} is not one of {', '.join(facings)}")
        if self.quaternion is not None and not abs(math.hypot(*self.quaternion) - 1.0) < ROUNDED:
            raise ValueError(f"quaternion {self.quaternion} has length {math.hypot(*self.quaternion):.3f}, not 1")


class AnchorReply(BaseModel, frozen=True, extra="forbid", allow_inf_nan=False):
    """A part and a region on it, or a point."""

    reason: str = ""
    part_index: int = Field(description="index of a listed part")
    regions: tuple[Region, ...] = ()
    references: tuple[str, ...] = ()
    constraints: tuple[Constraint, ...] = Field(
        default=(), description="constraints to keep beside the asked ones, which always hold"
    )
    point: tuple[float, float] | None = Field(
        default=None, description="aim on the part: right and front of its middle, -1..1; empty: the region decides"
    )

    def check(self, request: AnchorRequest) -> None:
        """Raise ValueError if it chooses something that is not listed."""
        indices = [part.index for part in request.parts]
        if self.part_index not in indices:
            raise ValueError(f"part_index {self.part_index} is not one of {indices}")
        unlisted = [r for r in self.references if r not in request.asked_references]
        if unlisted:
            raise ValueError(f"reference {unlisted[0]!r} is not one of {', '.join(request.asked_references) or 'none'}")
        targets = {*request.asked_references, *(one.id for one in (*request.neighbours, *request.references))}
        for constraint in self.constraints:
            constraint.check(targets | {f"part:{part.name}" for part in request.parts})
        if self.point is not None and max(abs(c) for c in self.point) > 1:
            raise ValueError(f"point {self.point} is outside -1..1")


class MaterialChoice(BaseModel, frozen=True, extra="forbid", allow_inf_nan=False):
    """A library row for one part."""

    body: str
    part_index: int
    reason: str = ""
    material: str = Field(description="id of a listed material")


class MaterialsReply(BaseModel, frozen=True, extra="forbid", allow_inf_nan=False):
    """One choice per question."""

    choices: tuple[MaterialChoice, ...]

    def check(self, request: MaterialsRequest) -> None:
        """Raise ValueError if a question is not answered exactly once or a material is not listed."""
        asked = [(q.body, q.part.index) for q in request.questions]
        given = [(c.body, c.part_index) for c in self.choices]
        if sorted(asked) != sorted(given):
            raise ValueError(f"choices answer {sorted(given)}, asked were {sorted(asked)}")
        known = {material.id for material in request.library}
        for choice in self.choices:
            if choice.material not in known:
                raise ValueError(
                    f"material {choice.material!r} of {choice.body}/{choice.part_index} is not in the library"
                )


class LabelGuess(BaseModel, frozen=True, extra="forbid", allow_inf_nan=False):
    """Further label that a thing may have."""

    label: str = Field(description="one of the listed labels")
    probability: float = Field(ge=0.0, le=1.0)


class LabelReply(BaseModel, frozen=True, extra="forbid", allow_inf_nan=False):
    """Label of a thing, with alternatives."""

    reason: str = ""
    label: str = Field(description="one of the listed labels, or other")
    confidence: float = Field(ge=0.0, le=1.0, description="probability that the label is right")
    others: tuple[LabelGuess, ...] = Field(
        default=(), description="what else it may be, the likeliest first; all probabilities add up to at most 1"
    )

    def check(self, request: LabelRequest) -> None:
        """Raise ValueError if it chooses something that is not listed."""
        for label in (self.label, *(one.label for one in self.others)):
            if label not in (*request.labels, OTHER):
                raise ValueError(f"label {label!r} is not one of {', '.join(request.labels)}, {OTHER}")

    @property
    def guesses(self) -> tuple[tuple[str, float], ...]:
        """All labels with a probability, the likeliest first."""
        known = [(self.label, self.confidence), *((one.label, one.probability) for one in self.others)]
        return tuple(sorted(((label, p) for label, p in known if label != OTHER), key=lambda one: -one[1]))


class PartName(BaseModel, frozen=True, extra="forbid", allow_inf_nan=False):
    """The name of one part."""

    index: int = Field(description="index of a listed part")
    name: str = Field(description="one of the listed names")
    confidence: float = Field(ge=0.0, le=1.0, description="probability that the name is right")


class PartsReply(BaseModel, frozen=True, extra="forbid", allow_inf_nan=False):
    """One name per part; parts of one name stay separate parts."""

    reason: str = ""
    names: tuple[PartName, ...]

    def check(self, request: PartsRequest) -> None:
        """Raise ValueError if a part is not named exactly once or a name is not listed."""
        asked = sorted(one.part.index for one in request.parts)
        given = sorted(one.index for one in self.names)
        if asked != given:
            raise ValueError(f"names are given to parts {given}, asked were {asked}")
        for one in self.names:
            if one.name not in request.names:
                raise ValueError(f"name {one.name!r} of part {one.index} is not one of {', '.join(request.names)}")
