"""The offline choice of a part: the asked one, else the one on which such a base carries things.

In: the anchor question with its listed parts. Out: one of them and why.
"""

import numpy as np

from dcap.language.offline.lexicon import default_parts, lineage, thing_of
from dcap.language.protocol.requests import AnchorRequest, PartView


def chosen_part(request: AnchorRequest) -> tuple[PartView, str]:
    """The part and why."""
    if request.asked_part:
        alike = [part for part in request.parts if part.name == request.asked_part]
        if alike:
            part = which_of(alike, request.asked_which, request)
            return part, f"the prompt asks for the {part.name}"
    for base in lineage(thing_id(request.base_label)):
        for name in default_parts().get(base, ()):
            alike = [part for part in request.parts if part.name == name and part.support_area > 0]
            if alike:
                return which_of(alike, sideways(request), request), f"a {base} carries things on its {name}"
    part = max(request.parts, key=lambda p: (round(p.support_area, 4), p.center[2], -p.index))
    return part, f"the {part.name} has the largest upward surface ({part.support_area:.2f} m2)"


def thing_id(label: str) -> str:
    """Thing id of a label, empty if unknown."""
    thing = thing_of(label)
    return thing.id if thing else ""


def sideways(request: AnchorRequest) -> str:
    """The asked left, right or middle, which picks among cushions that lie side by side."""
    sides = [r for r in request.asked_regions if r in ("left", "right", "middle", "center")]
    return sides[0] if sides else ""


def moved_into_which(request: AnchorRequest, part: PartView) -> bool:
    """Whether left or right already picked one of several parts side by side."""
    alike = [p for p in request.parts if p.name == part.name]
    return len(alike) > 1 and not request.asked_part and sideways(request) != "" and not request.asked_references


def one_of_a_whole(request: AnchorRequest, part: PartView) -> bool:
    """Whether "the left arm" was asked and one part holds both arms: then left says where on it."""
    alike = [p for p in request.parts if p.name == part.name]
    return len(alike) == 1 and request.asked_which in ("left", "right", "front", "back")


def which_of(alike: list[PartView], which: str, request: AnchorRequest) -> PartView:
    """The left, right, top, bottom, middle or n-th of parts with the same name; else the one that carries best."""
    word, counted = which.split()[0] if which else "", which.split()[-1] if which else ""
    along = sorted(alike, key=lambda p: (round(float(np.dot(p.center, request.right)), 3), p.index))
    upward = sorted(alike, key=lambda p: (round(p.center[2], 3), p.index))
    if word in ("left", "right"):
        return along[0 if word == "left" else -1]
    if word in ("front", "back"):
        sign = 1.0 if word == "front" else -1.0
        return max(alike, key=lambda p: (round(sign * float(np.dot(p.center, request.front)), 3), -p.index))
    if word in ("top", "bottom"):
        return upward[-1 if word == "top" else 0]
    if word in ("middle", "center"):
        stacked = np.ptp([p.center[2] for p in alike]) > 0.1
        return upward[(len(alike) - 1) // 2] if stacked else along[len(alike) // 2]  # the roof of a case is no middle
    if word.isdigit():
        order = along if counted in ("left", "right") else upward
        order = order[::-1] if counted in ("top", "right") else order
        return order[min(int(word), len(order)) - 1]
    if word == "last":
        return upward[0]
    largest = max(p.support_area for p in alike)
    good = [p for p in along if p.support_area >= 0.7 * largest]
    if np.ptp([p.center[2] for p in good]) > 0.1:  # boards above each other: the middle one
        return sorted(good, key=lambda p: (round(p.center[2], 3), p.index))[len(good) // 2]
    return good[len(good) // 2]
