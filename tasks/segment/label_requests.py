"""Questions about the things found in a room without annotations: one request per thing, carriers first."""

from collections.abc import Mapping, Sequence

import numpy as np

from dcap.geometry.segmentation.rooms.traits import Traits
from dcap.language.protocol.replies import OTHER, LabelReply
from dcap.language.protocol.requests import LabelRequest, Picture


def label_levels(traits: Sequence[Traits]) -> list[list[int]]:
    """Numbers of the things, level by level: where possible, what carries is in a level before what it carries."""
    waiting, levels = dict.fromkeys(range(len(traits))), list[list[int]]()
    while waiting:
        free = [i for i in waiting if traits[i].holder not in waiting]
        levels.append(free or [next(iter(waiting))])  # two that lean on each other: the larger one first
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
    """The question about one thing; `known` are the answers so far, `allowed` what it may be called."""
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
    """How a thing without a name is called in the requests."""
    return f"thing_{number}"
