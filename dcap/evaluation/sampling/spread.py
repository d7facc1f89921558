"""Chooses a few samples of a data set that differ as much as possible in scene, object, support and intended
outcome."""

from collections import Counter
from collections.abc import Sequence

from dcap.evaluation.outcome_table import ExpectedOutcome
from dcap.scene.types.sample import Sample


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
