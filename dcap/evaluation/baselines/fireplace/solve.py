"""The continuous solve, which yields a few diverse poses from many samples, and batched visual selection.

In: a `PlacementProblem` and a seed. Out: poses with their losses, the best first. Samples are points of the surface
with yaws in steps of 15 degrees; the best of them move by compass search (Kolda, Lewis, Torczon 2003: probe along each
axis, take what is better, else halve the step), which needs no derivatives, as the constraints have kinks. From the
source: that feasible placements are found by solving all constraints together. Ours: sampling, search and limits.

The selection, from the source [H25]: options in small batches, whose winners meet again, so that a model need not
compare dozens of pictures. Ours: batches of four, ids shuffled anew for each vote so that no position or letter is
preferred, two votes, and where they differ a last question between the two.

[H25] as in the package's docstring.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from string import ascii_uppercase

import numpy as np

from dcap.arrays import Array
from dcap.evaluation.baselines.fireplace.problem import PlacementProblem

BATCH = 4
"""Options that are compared at once [-]."""
VOTES = 2
"""Selections, each with options in another order [-]."""

Decide = Callable[[Sequence[tuple[str, int]]], int]
"""Chooses among a few options, each a letter and its number; returns the number."""
SAMPLES = 1024
"""Number of initial poses [-]."""
YAWS = 24
"""Yaws in steps of 15 degrees [-]."""
MOVED = 160
"""Number of best samples that are refined [-]."""
STEPS = np.array([0.06, 0.06, np.radians(10.0)])
"""First steps of the search [m, m, rad]."""
HALVINGS = 7
"""Number of times that steps are halved: to half a millimetre and a twelfth of a degree [-]."""
MOST_ROUNDS = 60
"""[-]."""
SATISFIED = 1e-3
"""Loss below which all constraints count as met [-]."""
SAME_LOSS = 1e-4
"""Losses that differ by less are equal [-]."""
SAME_DEPTH = 0.02
"""Distances from the rim that differ by less are equal [m]."""
SLACK = 1.2
"""If not all constraints can be met: losses up to this multiple of the least count as equally good [-]."""
MOST_LIFTED = 0.25
"""Lift off the surface over the object's height, above which it lies on something else [-]."""
MOST_OVERHANG = 0.5
"""Share of its contact surface beyond the rim above which a thing falls [-]."""
WAYS = np.concatenate([np.eye(3), -np.eye(3)])


def batched_selection(count: int, decide: Decide, rng: np.random.Generator, *, batch: int = BATCH) -> int:
    """The winner of `count` options by votes; the only option needs no question."""
    if count == 1:
        return 0
    winners = list(dict.fromkeys(one_vote(count, decide, rng, batch) for _ in range(VOTES)))
    return winners[0] if len(winners) == 1 else decide(lettered(winners, rng))


def one_vote(count: int, decide: Decide, rng: np.random.Generator, batch: int) -> int:
    """The winner of one tournament: in each round the winners of the batches of the last."""
    left = list(range(count))
    while len(left) > 1:
        shuffled = [left[k] for k in rng.permutation(len(left))]
        left = [winner(group, decide, rng) for group in batches(shuffled, batch)]
    return left[0]


def winner(group: Sequence[int], decide: Decide, rng: np.random.Generator) -> int:
    """The winner of one batch; an only option wins without a question."""
    return group[0] if len(group) == 1 else decide(lettered(group, rng))


def batches(numbers: Sequence[int], size: int) -> list[list[int]]:
    """Groups of nearly equal size, none larger than `size`."""
    return [list(group) for group in np.array_split(np.array(numbers), -(-len(numbers) // size))]


def lettered(numbers: Sequence[int], rng: np.random.Generator) -> list[tuple[str, int]]:
    """The options with letters in random order, listed by letter."""
    letters = rng.permutation(len(numbers))
    return sorted((ascii_uppercase[letter], int(number)) for letter, number in zip(letters, numbers, strict=True))


def farthest_points(points: np.ndarray[tuple[int, ...], np.dtype[np.float64]], most: int) -> list[int]:
    """Up to `most` of points (n, d), each the farthest from those before it, the first one first."""
    chosen = [0]
    gap = np.linalg.norm(points - points[0], axis=1)
    while len(chosen) < min(most, len(points)):
        best = int(np.argmax(gap))
        if gap[best] <= 1e-9:
            break
        chosen.append(best)
        gap = np.minimum(gap, np.linalg.norm(points - points[best], axis=1))
    return chosen


@dataclass(frozen=True, eq=False, slots=True)
class SolvedPoses:
    """Poses that satisfy the constraints as well as any, in the frame of the surface."""

    poses: Array
    """x, y [m], yaw [rad], the best first, then each the farthest from those before it, shape (n, 3)."""
    loss: Array
    """[-], shape (n,)."""
    height: Array
    """[m], shape (n,)."""
    overhang: Array
    """[-], shape (n,)."""
    least_overhang: float
    """Least overhang of all evaluated poses with nothing in the way [-]."""


def solved(problem: PlacementProblem, seed: int, most: int) -> SolvedPoses:
    """Up to `most` poses; none if every pose is blocked or would fall."""
    rng = np.random.default_rng(seed)
    start = samples(problem, rng)
    first = problem.evaluate(start)
    order = np.argsort(first.loss, kind="stable")[:MOVED]
    poses = compass_search(problem, start[order], first.loss[order])
    found = problem.evaluate(poses)
    free = dict(found.terms)["contact"] < MOST_LIFTED
    good = np.flatnonzero(free & (found.overhang < MOST_OVERHANG))
    least = float(found.overhang[free].min(initial=1.0))
    if len(good) == 0:
        none = np.zeros(0)
        return SolvedPoses(np.zeros((0, 3)), none, none, none, least)
    limit = max(SATISFIED, SLACK * float(found.loss[good].min()) + SATISFIED)
    good = good[found.loss[good] <= limit]
    # of equally good ones the one farthest from the rim comes first, then the one nearest to the middle
    depth = np.round(problem.area.depth_at(poses[good, :2]) / SAME_DEPTH)
    off = np.linalg.norm(poses[good, :2] - problem.area.middle, axis=1)
    good = good[np.lexsort((off, -depth, np.round(found.loss[good] / SAME_LOSS)))]
    reach = 0.5 * float(np.linalg.norm(problem.footprint, axis=1).max())
    yaw = poses[good, 2]
    spread = np.c_[poses[good, :2], reach * np.cos(yaw), reach * np.sin(yaw)]
    chosen = good[farthest_points(spread, most)]
    return SolvedPoses(poses[chosen], found.loss[chosen], found.height[chosen], found.overhang[chosen], least)


def samples(problem: PlacementProblem, rng: np.random.Generator) -> Array:
    """Points of the surface with yaws, of its middle and its deepest point with every yaw first, shape (n, 3)."""
    yaw = 2.0 * np.pi / YAWS * np.arange(YAWS)
    inside = problem.area.middles()
    deepest = inside[int(np.argmax(problem.area.depth_at(inside)))]
    points = inside[rng.integers(len(inside), size=SAMPLES)]
    points = points + problem.area.cell * rng.uniform(-0.5, 0.5, size=points.shape)
    fixed = [np.c_[np.tile(one, (YAWS, 1)), yaw] for one in (problem.area.middle, deepest)]
    return np.concatenate([*fixed, np.c_[points, rng.choice(yaw, SAMPLES)]])


def compass_search(problem: PlacementProblem, poses: Array, loss: Array) -> Array:
    """Poses (n, 3) with losses (n,), each moved to where no step along an axis makes it better."""
    poses, loss = poses.copy(), loss.copy()
    scale = np.ones(len(poses))
    for _ in range(MOST_ROUNDS):
        active = np.flatnonzero(scale > 0.5 ** (HALVINGS + 0.5))
        if len(active) == 0:
            break
        probes = poses[active, None] + scale[active, None, None] * (WAYS * STEPS)
        value = problem.evaluate(probes.reshape(-1, 3)).loss.reshape(len(active), len(WAYS))
        best = np.argmin(value, axis=1)
        lower = value[np.arange(len(active)), best] < loss[active] - 1e-9
        moved = active[lower]
        poses[moved] = probes[lower, best[lower]]
        loss[moved] = value[lower, best[lower]]
        scale[active[~lower]] *= 0.5
    return poses
