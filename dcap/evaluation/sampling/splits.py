"""Splits of a data set by scene, and a choice of few samples that differ as much as possible.

No scene is in two splits. The draw depends on the names of the scenes and the seed, not on their order.

Chooses a few samples of a data set that differ as much as possible in scene, object, support and intended
outcome.
"""

import re
from collections import Counter
from collections.abc import Mapping, Sequence
from math import isfinite

from dcap.evaluation.outcome_table import ExpectedOutcome
from dcap.evaluation.sampling.requests import chance
from dcap.scene.errors import InputError
from dcap.scene.types.sample import Sample

NAME = re.compile(r"[A-Za-z][A-Za-z0-9_-]*")
ROUNDING = 1e-6
"""Tolerance of the sum of shares [-]."""


def shares_of(text: str) -> dict[str, float]:
    """Shares by name from `train=0.8,val=0.1,test=0.1`; InputError for invalid shares, or a sum other than 1."""
    shares: dict[str, float] = {}
    for word in text.split(","):
        name, _, value = (part.strip() for part in word.partition("="))
        try:
            share = float(value)
        except ValueError:
            share = -1.0
        if not NAME.fullmatch(name) or name in shares or not isfinite(share) or not 0.0 < share <= 1.0:
            raise InputError(
                f"--splits {text!r}: {word.strip()!r} is no share of its own; train=0.8,val=0.1,test=0.1 is one"
            )
        shares[name] = share
    if abs(sum(shares.values()) - 1.0) > ROUNDING:
        raise InputError(f"--splits {text!r}: the shares add up to {sum(shares.values()):g}, expected 1")
    return shares


def split_scenes(scenes: Sequence[str], shares: Mapping[str, float], seed: int) -> dict[str, tuple[str, ...]]:
    """The scenes of each split, sorted; sizes by largest remainders. InputError if a split would be empty."""
    order = sorted(scenes, key=lambda one: (chance(seed, "split", one), one))
    exact = {name: share * len(order) for name, share in shares.items()}
    sizes = {name: int(size + ROUNDING) for name, size in exact.items()}
    for name in sorted(exact, key=lambda one: sizes[one] - exact[one])[: len(order) - sum(sizes.values())]:
        sizes[name] += 1
    empty = next((name for name, size in sizes.items() if size == 0), "")
    if empty:
        raise InputError(f"--splits: {empty} would have none of {len(order)} scenes; give it a larger share")
    found, begin = {}, 0
    for name, size in sizes.items():
        found[name] = tuple(sorted(order[begin : begin + size]))
        begin += size
    return found


def spread_samples(
    samples: Sequence[Sample], truths: Sequence[ExpectedOutcome | None], limit: int | None
) -> list[Sample]:
    """At most `limit` samples, in their order; all if it is None.

    Infeasible samples keep their share, at least one if there is any and the limit allows two. Within either group,
    each next sample is one whose scene, object and support were chosen least often, and among several the one farthest
    in the list from all chosen ones.
    """
    if limit is None or limit >= len(samples):
        return list(samples)
    refused = [at for at, truth in enumerate(truths) if truth is not None and not truth.feasible]
    others = [at for at in range(len(samples)) if at not in set(refused)]
    quota = min(max(round(limit * len(refused) / len(samples)), 1), len(refused)) if limit > 1 or not others else 0
    chosen: list[int] = []
    seen: Counter[tuple[str, str]] = Counter()

    def often(at: int) -> int:
        return sum(seen[one] for one in traits_of(samples[at], truths[at]))

    for group, count in ((others, limit - quota), (refused, quota)):
        left = list(group)
        for _ in range(min(count, len(left))):
            best = min(left, key=lambda at: (often(at), -min((abs(at - one) for one in chosen), default=0)))
            seen.update(traits_of(samples[best], truths[best]))
            left.remove(best)
            chosen.append(best)
    return [samples[at] for at in sorted(chosen)]


def traits_of(sample: Sample, truth: ExpectedOutcome | None) -> tuple[tuple[str, str], ...]:
    """Traits that distinguish samples."""
    return ("scene", sample.scene), ("object", sample.object), ("support", truth.base if truth else "")
