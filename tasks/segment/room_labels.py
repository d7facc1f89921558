"""A room without annotations: its shell, and the things in it with the labels chosen by a client.

In: the unnamed faces. Out: groups of faces with labels and their certainties. Each thing is one question; supports are
asked about first, so that the question about a thing on a bed mentions the bed; things of one level are asked about
together. The instances of a scene with earlier placements come from its folder: nothing is asked or found again.

Of a room that a scan has fused, the unions of pieces that are things are those most similar to usual things. The worth
of a union is the evidence of its rough shape for some label over no knowledge, less the cost of assuming one more thing
(otherwise every piece would be a thing) and of cutting it out of the surface around it. Labels are only assumed here; a
client chooses them later. A room is wet or dry, whichever explains more: a seat of 40 cm is a stool in a living room.
"""

import math
from collections.abc import Mapping, Sequence
from functools import partial

import numpy as np
from numpy.typing import NDArray

from dcap.geometry.segmentation.boxed import Group
from dcap.geometry.segmentation.faces import FaceTable
from dcap.geometry.segmentation.named import THING, shell_groups
from dcap.geometry.segmentation.rooms.composites import ONLY_PARTS, composites
from dcap.geometry.segmentation.rooms.decomposition import DecomposedRoom, decompose_room
from dcap.geometry.segmentation.rooms.traits import FLOOR, Traits, describe_things, thing_segments
from dcap.geometry.segmentation.rooms.unions import RoughShape, worth_most
from dcap.knowledge.shapes import colour_measures, evidence, labels, shapes
from dcap.language.connect import Client
from dcap.language.protocol.questions import LABEL
from dcap.language.protocol.replies import OTHER, LabelReply
from dcap.language.protocol.requests import LabelRequest, Picture
from dcap.scene.types.earlier import EarlierPlacements
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.scan import Scan
from dcap.scene.types.segmentation import Segmentation, part_nodes
from tasks.requests.pictures import close_up, in_the_room

PER_THING = 8.5
"""Evidence needed for one more thing [nats]: position and size, each to within a few per cent of the room's range."""
BURIED = 4.0
"""Evidence against a thing if another thing grows out of its whole top [nats]: a board is not a stool."""
CUT = 0.4
"""Evidence needed per metre of edge to a neighbouring thing [nats/m]: things touch along short edges."""
COMMON = {"dry": 1.0, "wet": 1.0 / 8.0}
"""Number of scanned bathrooms for every other scanned room [-]: an estimate."""

MOST_LEVELS = 4
"""Maximum number of levels; more add nothing [-]: the boards of a shelf carry upward surfaces too."""

Union = frozenset[int]


def likely_things(unions: Sequence[Union], rough: Sequence[RoughShape]) -> list[Union]:
    """The disjoint unions that explain most."""
    number = {union: i for i, union in enumerate(unions)}
    measures, holders = [rough_measures(one) for one in rough], [one.held_by for one in rough]
    best: tuple[float, list[Union]] = (-math.inf, [])
    for room in COMMON:
        found = evidence(measures, holders, room, ONLY_PARTS)
        against = [BURIED * one.buried + CUT * one.cut + PER_THING for one in rough]
        worth: NDArray[np.float64] = found.nats - np.array(against)
        chosen = worth_most(unions, worth.tolist())
        total = explained(room, [(found.label[i], float(worth[i])) for i in (number[union] for union in chosen)])
        best = max(best, (total, chosen), key=lambda one: one[0])
    return best[1]


def room_labels(measures: Sequence[Mapping[str, float]], holders: Sequence[str]) -> tuple[str, ...]:
    """Possible names of things with these measures and supports, in such a room."""

    def explains(room: str) -> float:
        found = evidence(measures, holders, room, ONLY_PARTS)
        worth = [(label, nats - PER_THING) for label, nats in zip(found.label, found.nats.tolist(), strict=True)]
        return explained(room, [one for one in worth if one[1] > 0.0])

    room = max(COMMON, key=explains)
    odd = {shape.label for shape in shapes() if shape.room not in ("", room)}
    return tuple(label for label in labels() if label not in odd)


def explained(room: str, things: Sequence[tuple[str, float]]) -> float:
    """The worth of such a room with things by label [nats]; a kind that stands in wet rooms counts only once, so that a
    second toilet adds nothing."""
    wet = {shape.label for shape in shapes() if shape.room == "wet"}
    total, seen = math.log(COMMON[room]), set[str]()
    for label, worth in sorted(things, key=lambda one: -one[1]):
        total += 0.0 if label in wet & seen else worth
        seen.add(label)
    return total


def rough_measures(shape: RoughShape) -> dict[str, float]:
    """The measures of a rough shape, under the names used in the table of shapes."""
    bottom = shape.bottom or 0.0
    length, width, height = (max(size, 1e-3) for size in (shape.length, shape.width, shape.top - bottom))
    found = {"length": math.log(length), "width": math.log(width), "height": math.log(height)}
    if shape.bottom is not None:
        found["bottom"] = shape.bottom
    if shape.wall_gap is not None:
        found["gap"] = shape.wall_gap
    if shape.color is not None:
        found |= colour_measures(shape.color)
    if not shape.top_seen:
        found["levels"] = float(min(shape.levels, MOST_LEVELS))
    elif shape.level_height is not None:
        found |= {
            "level": shape.level_height,
            "rise": shape.top - shape.level_height,
            "share": min(shape.level_area / (length * width), 1.0),
        }
    return found


def label_levels(traits: Sequence[Traits]) -> list[list[int]]:
    """Indices of the things, level by level: where possible, a support is in an earlier level than the things on it."""
    waiting, levels = dict.fromkeys(range(len(traits))), list[list[int]]()
    while waiting:
        free = [i for i in waiting if traits[i].holder not in waiting]
        levels.append(free or [next(iter(waiting))])  # two things that lean on each other: the larger first
        for i in levels[-1]:
            del waiting[i]
    return levels


def label_request(
    number: int,
    traits: Sequence[Traits],
    known: Mapping[int, LabelReply],
    pictures: tuple[Picture, ...],
    allowed: tuple[str, ...],
) -> LabelRequest:
    """The question about one thing; `known` are the answers so far, `allowed` the possible names."""
    one = traits[number]
    carrier = known.get(one.holder)
    return LabelRequest(
        id=thing_id(number),
        size=(one.length, one.width, one.height),
        bottom=one.bottom,
        top=one.top,
        level_height=None if np.isnan(one.level_height) else one.level_height,
        level_area=one.level_area,
        rise=one.rise,
        levels=one.levels,
        closed=one.closed,
        covered=one.covered,
        waist=one.waist,
        rough=one.rough,
        held_by=one.held_by or thing_id(one.holder),
        holder=one.held_by or (carrier.label if carrier else OTHER),
        wall_gap=one.wall_gap if np.isfinite(one.wall_gap) else None,
        carries=one.carries,
        color=one.color,
        varied=one.varied,
        balance=one.balance,
        labels=allowed,
        pictures=pictures,
    )


def thing_id(number: int) -> str:
    """Name of an unnamed thing in the requests."""
    return f"thing_{number}"


def labelled_room(mesh: Mesh, table: FaceTable, inside: NDArray[np.bool_], client: Client) -> list[Group]:
    """Divide the faces in `inside`, shape (m,), into things, ask for the name of each, and join related things."""
    room = decompose_room(table, inside, likely_things)
    pieces = thing_segments(table, room)
    traits = describe_things(table, room, pieces)
    replies = asked(mesh, room, traits, client)
    given = ["" if reply.label == OTHER else reply.label for reply in replies]
    found = [
        Group(
            "",
            whole.label or THING,
            np.sort(np.concatenate([room.things[i] for i in whole.members])),
            None,
            replies[whole.main].confidence if whole.label else 0.0,
            replies[whole.main].guesses,
            floor_below(room, whole.main),
        )
        for whole in composites(given, traits, pieces)
    ]
    return shell_groups(room.shell) + found


def floor_below(room: DecomposedRoom, number: int) -> float | None:
    """Height of the floor under a thing whose feet may be missing in a fused scan [m]; None if its own faces show
    it."""
    if not room.fused or room.fused[number].shape.held_by != FLOOR or np.isnan(room.shell.levels.floor):
        return None
    return room.shell.levels.floor


def asked(mesh: Mesh, room: DecomposedRoom, traits: tuple[Traits, ...], client: Client) -> list[LabelReply]:
    """The client's answer for each thing."""
    known: dict[int, LabelReply] = {}
    allowed = labels()
    if room.fused:  # from all measures of the candidates there
        likely = [i for i, one in enumerate(room.fused) if one.likely]
        measures = [label_request(i, traits, {}, (), allowed).measures() for i in likely]
        allowed = room_labels(measures, [traits[i].held_by for i in likely])

    def request(i: int) -> LabelRequest:
        pictures = (
            Picture(
                "the room, the thing in bright magenta", partial(in_the_room, mesh, room, traits[i].box, room.things[i])
            ),
            Picture("the thing from near", partial(close_up, mesh, room, traits[i].box, room.things[i])),
        )
        return label_request(i, traits, known, pictures, allowed)

    for level in label_levels(traits):
        known.update(zip(level, client.ask_all(LABEL, [request(i) for i in level]), strict=True))
    return [known[i] for i in range(len(traits))]


def known_scene(scan: Scan, earlier: EarlierPlacements) -> Segmentation:
    """The segmentation of a scan whose nodes are parts of instances: `id/part`."""
    place = {
        node: (number, part)
        for number, one in enumerate(earlier.instances)
        for part, node in enumerate(part_nodes(one.id, [own.name for own in one.parts]))
    }
    owner = np.array([*(place.get(name, (-1, -1)) for name in scan.node_names), (-1, -1)], dtype=np.int32)
    instance, part = owner[scan.face_node].T
    return Segmentation(
        scan.mesh, earlier.instances, np.ascontiguousarray(instance), np.ascontiguousarray(part),
        unit_source=scan.unit_source,
    )  # fmt: skip
