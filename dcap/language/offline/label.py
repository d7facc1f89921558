"""The label of a thing by its shape, size and height.

In: a `LabelRequest`. Out: the label that fits best, and its confidence: the probability of the best label among all
labels; below DOUBT a thing remains a thing.
"""

import math

from dcap.knowledge.shapes import NOT_HELD, NOTHING_KNOWN, shapes
from dcap.language.protocol.replies import OTHER, LabelGuess, LabelReply
from dcap.language.protocol.requests import LabelRequest

DOUBT = 0.35
"""Least probability of an assigned label [-]; a doubtful one mostly competes with a kind of the same thing."""
LEAST_GUESS = 0.01
"""Labels less probable than this are not reported [-]."""


def probabilities(request: LabelRequest) -> dict[str, float]:
    """Probability of every label that may be chosen, and of `other`; they sum to 1."""
    measures = request.measures()
    score = [
        (one.label, one.log_probability(request.holder, measures)) for one in shapes() if one.label in request.labels
    ]
    score.append((OTHER, math.log(NOTHING_KNOWN * NOT_HELD)))
    best = max(value for _, value in score)
    total = sum(math.exp(value - best) for _, value in score)
    result = dict.fromkeys((label for label, _ in score), 0.0)
    for label, value in score:
        result[label] += math.exp(value - best) / total
    return result


def label_of(request: LabelRequest) -> LabelReply:
    """The most probable label, or `other` if none is probable."""
    ranked = sorted(probabilities(request).items(), key=lambda one: (-one[1], one[0]))
    (first, sure), (second, less) = ranked[0], ranked[1] if len(ranked) > 1 else (OTHER, 0.0)
    length, width, height = request.size
    shape = f"{length:.2f} x {width:.2f} x {height:.2f} m, held by {request.holder}"
    reason = f"{shape}: {first} {sure:.0%}, {second} {less:.0%}"
    others = [LabelGuess(label=label, probability=p) for label, p in ranked if p > LEAST_GUESS and label != OTHER]
    if sure >= DOUBT or first == OTHER:
        return LabelReply(
            label=first, confidence=sure, others=tuple(g for g in others if g.label != first), reason=reason
        )
    unknown = dict(ranked)[OTHER]
    return LabelReply(label=OTHER, confidence=unknown, others=tuple(others), reason=reason)
