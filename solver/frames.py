"""Recorded motion of bodies on their way to rest: states kept at intervals of motion, not of time.

A drop falls for a while and then creeps into its dent: a state is kept when a point has moved by a share of the size of
the moving bodies, and the share doubles when there are too many states. The first and the last state are always kept.
"""

from collections.abc import Callable, Sequence

import numpy as np

from solver.model.bodies import Body
from solver.motion import BodyPath, DropFrames
from solver.result import RestBody

MOTION = 0.004
"""Motion of a point between two frames, over the size of the moving bodies [-]: a few pixels in a picture of them."""
MOST_FRAMES = 96
"""Maximum number of frames [-]."""
STILL = 2e-5
"""Points that never deviate from the motion of their body by more than this are not stored [m]: no picture shows it."""

Snapshot = Callable[[], tuple[RestBody, ...]]
"""Function that returns the state of all bodies."""


class FrameRecorder:
    """Keeps frames of a running simulation."""

    def __init__(self, bodies: Sequence[Body], size: float) -> None:
        self._start = [body.vertices for body in bodies]
        self._least = MOTION * size
        self._kept: list[tuple[float, tuple[RestBody, ...]]] = []

    def note(self, time: float, snapshot: Snapshot, *, last: bool = False) -> None:
        """Record a state at `time` [s]; it is kept if a body has moved since the last kept state, and always if it is
        the last."""
        now = snapshot()
        if self._kept and self._moved(self._kept[-1][1], now) < self._least and not last:
            return
        self._kept.append((time, now))
        if len(self._kept) > MOST_FRAMES:
            self._least *= 2.0
            self._thin()

    def _thin(self) -> None:
        """Drop frames with too little motion since the last kept one; the newest stays."""
        thinner = self._kept[:1]
        for one in self._kept[1:-1]:
            if self._moved(thinner[-1][1], one[1]) >= self._least:
                thinner.append(one)
        self._kept = [*thinner, self._kept[-1]]

    @staticmethod
    def _moved(before: tuple[RestBody, ...], now: tuple[RestBody, ...]) -> float:
        """Largest motion of a surface point [m]."""
        pairs = zip(before, now, strict=True)
        return max(float(np.abs(b.vertices - a.vertices).max(initial=0.0)) for a, b in pairs)

    def frames(self) -> DropFrames:
        """The recorded frames."""
        paths = []
        for index, start in enumerate(self._start):
            states = [bodies[index] for _, bodies in self._kept]
            off = [one.vertices - (start @ one.rotation.T + one.translation) for one in states]
            largest = np.max([np.abs(each).max(axis=1) for each in off], axis=0)
            moved = np.flatnonzero(largest > STILL).astype(np.int32)
            paths.append(
                BodyPath(
                    np.stack([one.rotation for one in states]),
                    np.stack([one.translation for one in states]),
                    moved,
                    np.stack([each[moved] for each in off]).astype(np.float32),
                )
            )
        return DropFrames(np.array([time for time, _ in self._kept]), tuple(paths))
