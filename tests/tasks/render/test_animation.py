"""Frames of a drop as pictures."""

import numpy as np
from dented_bed import anchor, ball, scene_of
from placed_ball import FRAMES, moving

from dcap.geometry.camera import looking_at
from dcap.scene.types.mesh import SourceSurface
from tasks.render.config import RenderConfig
from tasks.render.motion import drop_pictures

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
