"""Frames of a drop: the first is before it, the last is the rest state, and dents only deepen between."""

import numpy as np
import pytest
from dented_bed import DEPTH, anchor, ball, scene_of, settled
from placed_ball import FRAMES, SLIDE, moving, pushed

from dcap.geometry.camera import looking_at
from dcap.scene.types.mesh import SourceSurface
from dcap.scene.types.settled import surface_at
from tasks.render.config import RenderConfig
from tasks.render.motion import DropMotion, MovingPoints, MovingScene, drop_pictures
from tasks.render.settled_meshes import settled_scene

SHARE = np.linspace(0.0, 1.0, FRAMES)
SINGLE = 1e-6
"""Offsets of frames are kept in single precision [m]."""


def test_the_scene_follows_each_frame() -> None:
    """At the start it is level, at the end the settled scene, in between as deep as the frame's share."""
    scene = MovingScene(scene_of(), DropMotion(moving()), "bed")
    end = settled_scene(scene_of(), settled(), "bed")
    assert scene.at(0).vertices == pytest.approx(end.start.vertices, abs=1e-9)
    assert scene.at(FRAMES - 1).vertices == pytest.approx(end.scene.mesh.vertices, abs=SINGLE)
    start = scene.scene.mesh.vertices[:, 2]
    depth = [float((start - scene.at(frame).vertices[:, 2]).max()) for frame in range(FRAMES)]
    assert depth == pytest.approx(SHARE**2 * DEPTH, abs=1e-3)  # the dent is a fan of chords 15 mm long


def test_a_thing_that_was_placed_before_moves_with_its_own_body() -> None:
    """The crate slides as a whole; none of its faces bend, and what carries it stays."""
    known, rest = pushed()
    scene = MovingScene(known, DropMotion(rest), "bed")
    own = scene.scene.face_instance == known.index_of("crate")
    mine = np.unique(scene.scene.mesh.faces[own])
    for frame in range(FRAMES):
        moved = scene.at(frame).vertices[mine] - scene.scene.mesh.vertices[mine]
        assert moved == pytest.approx(np.tile(SHARE[frame] * SLIDE, (len(mine), 1)), abs=1e-9)
    assert not scene.bending()[own].any()


def test_points_of_a_body_that_deforms_follow_its_surface() -> None:
    """Points of the bed's own surface are where the surface is at each frame; those of the ball are turned with it."""
    motion = DropMotion(moving())
    assert (motion.deforms(0), motion.deforms(1)) == (False, True)
    for body in (0, 1):
        points = MovingPoints.of_body(motion, body, motion.start(body).vertices)
        assert points.bends == motion.deforms(body)
        for frame in range(FRAMES):
            assert points.at(frame) == pytest.approx(surface_at(motion.settled, body, frame), abs=SINGLE)


PLAIN = SourceSurface.untextured()


def test_pictures_of_a_drop():
    camera = looking_at(np.array([0.3, -0.8, 0.9]), np.array([0.0, 0.0, 0.55]), 64, 64, fov_deg=40.0)
    pictures = list(
        drop_pictures(scene_of(), ball(), anchor(), moving(), (PLAIN, PLAIN), camera, RenderConfig(size=64, samples=1))
    )
    assert len(pictures) == FRAMES
    red = [(one[..., 0].astype(int) - one[..., 1] > 60) for one in pictures]
    rows = [np.flatnonzero(one.any(axis=1)).mean() for one in red]
    assert rows == sorted(rows)  # it comes down
    assert rows[-1] > rows[0]
