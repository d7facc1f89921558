"""What is asked about the things found in a room without annotations: one request per thing, carriers first."""

from collections.abc import Mapping, Sequence

import numpy as np

from geometry.segmentation.traits import Traits
from language.replies import OTHER, LabelReply
from language.requests import LabelRequest, PictureMaker
from language.shapes import labels


def label_order(traits: Sequence[Traits]) -> list[int]:
    """Numbers of the things such that what carries comes before what it carries, wherever that is possible."""
    waiting, order = dict.fromkeys(range(len(traits))), list[int]()
    while waiting:
        free = [i for i in waiting if traits[i].holder not in waiting]
        for i in free or [next(iter(waiting))]:  # two that lean on each other: the larger one first
            order.append(i)
            del waiting[i]
    return order


def label_request(
    number: int, traits: Sequence[Traits], known: Mapping[int, LabelReply], pictures: tuple[PictureMaker, ...]
) -> LabelRequest:
    """The question about one thing; `known` are the answers so far."""
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
        labels=labels(),
        pictures=pictures,
    )


def thing_id(number: int) -> str:
    """How a thing without a name is called in the requests."""
    return f"thing_{number}"
