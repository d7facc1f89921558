"""A room without annotations: its shell, and the things in it with the labels that a client gave them.

In: the faces that nobody named. Out: groups of faces with labels and how sure those are. Each thing is one question;
what carries others is asked first, so that what lies on a bed knows it; things of one level are asked together.
"""

from functools import partial

import numpy as np
from numpy.typing import NDArray

from dcap.geometry.segmentation.boxed import Group
from dcap.geometry.segmentation.faces import FaceTable
from dcap.geometry.segmentation.named import THING, shell_groups
from dcap.geometry.segmentation.rooms.composites import composites
from dcap.geometry.segmentation.rooms.decomposition import DecomposedRoom, decompose_room
from dcap.geometry.segmentation.rooms.traits import FLOOR, Traits, describe_things, thing_segments
from dcap.language.connect import Client
from dcap.language.offline.shapes import labels, measures_of
from dcap.language.protocol.questions import LABEL
from dcap.language.protocol.replies import OTHER, LabelReply
from dcap.language.protocol.requests import LabelRequest, Picture
from dcap.scene.types.mesh import Mesh
from tasks.requests.pictures import close_up, in_the_room
from tasks.segment.fused_rooms import likely_things, room_labels
from tasks.segment.label_requests import label_levels, label_request


def labelled_room(mesh: Mesh, table: FaceTable, inside: NDArray[np.bool_], client: Client) -> list[Group]:
    """Take the faces in `inside`, shape (m,), apart, ask what each thing is, and join what belongs together."""
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
    """Height of the floor under a thing whose feet a fused scan may not show [m]; None where its faces tell."""
    if not room.fused or room.fused[number].shape.held_by != FLOOR or np.isnan(room.shell.levels.floor):
        return None
    return room.shell.levels.floor


def fused_labels(room: DecomposedRoom, traits: tuple[Traits, ...]) -> tuple[str, ...]:
    """Things that may stand in a fused room, by everything known of the candidates there."""
    likely = [i for i, one in enumerate(room.fused) if one.likely]
    measures = [measures_of(label_request(i, traits, {}, (), labels())) for i in likely]
    return room_labels(measures, [traits[i].held_by for i in likely])


def asked(mesh: Mesh, room: DecomposedRoom, traits: tuple[Traits, ...], client: Client) -> list[LabelReply]:
    """The client's answer for each thing."""
    known: dict[int, LabelReply] = {}
    allowed = fused_labels(room, traits) if room.fused else labels()

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
