"""Frames of a drop: kept where something moved, thinned where there are many, first and last always there."""

from functools import partial

import numpy as np
import pytest

from solver.frames import MOST_FRAMES, STILL, FrameRecorder
from solver.result import RestBody

START = np.random.default_rng(0).uniform(-1.0, 1.0, (40, 3))


class OneBody:
    """What a recorder asks of a body."""

    vertices = START


def state(shift, offset=None):
    moved = START + shift + (0.0 if offset is None else offset)
    return (RestBody("one", moved, np.eye(3), np.asarray(shift, dtype=float), 0.0),)


def recorded(shifts, size=1.0):
    recorder = FrameRecorder([OneBody()], size)  # type: ignore[list-item]
    for index, shift in enumerate(shifts):
        recorder.note(float(index), partial(state, shift))
    recorder.note(float(len(shifts)), lambda: state(shifts[-1]), last=True)
    return recorder.frames()


def test_a_body_that_stands_still_has_its_first_and_last_frame():
    assert recorded([np.zeros(3)] * 50).time.tolist() == [0.0, 50.0]


def test_a_long_fall_is_thinned_and_keeps_both_ends():
    frames = recorded([np.array([0.0, 0.0, -0.01 * i]) for i in range(1000)])
    assert len(frames.time) <= MOST_FRAMES + 1
    assert frames.time[[0, -1]].tolist() == [0.0, 1000.0]
    steps = -np.diff(frames.bodies[0].translation[:, 2])
    assert steps[:-1].max() < 3.0 * steps[:-1].min()  # evenly spread over the way


def test_only_points_that_leave_the_body_s_own_motion_are_stored():
    recorder = FrameRecorder([OneBody()], 1.0)  # type: ignore[list-item]
    dent = np.zeros_like(START)
    dent[7] = (0.0, 0.0, -0.05)
    recorder.note(0.0, lambda: state(np.zeros(3)))
    recorder.note(1.0, lambda: state(np.zeros(3), dent), last=True)
    path = recorder.frames().bodies[0]
    assert path.moved.tolist() == [7]
    assert path.offset[1] == pytest.approx(dent[[7]], abs=1e-7)
    assert STILL < 1e-4


def test_the_last_frame_is_the_rest_state_and_frames_follow_the_sinking(lab):
    slab = lab.soft("slab", lab.Box(np.array([0.2, 0.2, 0.1])), [0, 0, 0.05], E=2e4, cell=0.02, held=np.s_[:, :, 0],
                    fixed=True, loaded=True)  # fmt: skip
    ball = lab.rigid("ball", lab.Capsule(lab.radius, 0.0), [0, 0, 0.16], mass=1.0, edge=0.01)
    result = lab.drop(ball, slab)
    frames = result.frames
    starts = [np.asarray(one.vertices) for one in (ball, slab)]
    for start, body, path in zip(starts, result.bodies, frames.bodies, strict=True):
        last = start @ path.rotation[-1].T + path.translation[-1]
        last[path.moved] += path.offset[-1]
        assert np.abs(last - body.vertices).max() < 2 * STILL
    assert (np.diff(frames.time) > 0.0).all()
    assert len(frames.bodies[0].moved) == 0  # rigid
    dent = frames.bodies[1].offset[:, :, 2].min(axis=1)
    assert abs(dent[0]) < 1e-12
    assert dent[-1] < -0.005
