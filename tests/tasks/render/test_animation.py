"""Frames of a drop as pictures: the first is before it, the last is the rest state, and dents only deepen between."""

from dataclasses import replace

import numpy as np
import pytest
from dented_bed import anchor, ball, box_mesh, scene_of, settled

from dcap.geometry.camera import looking_at
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.paint import SourceSurface
from dcap.scene.types.settled import SettledBody
from solver.motion import BodyPath, DropFrames
from tasks.render.animation import MOST_PICTURES, MovingScene, chosen_frames, drop_pictures
from tasks.render.config import RenderConfig
from tasks.render.settled_meshes import settled_scene

PLAIN = SourceSurface.untextured()
COUNT = 4


def moving():
    """The dented bed with frames in which ball and dent come down evenly."""
    own, bed = settled().bodies
    share = np.linspace(0.0, 1.0, COUNT)[:, None]
    still = np.tile(np.eye(3), (COUNT, 1, 1))
    moved = np.flatnonzero(np.abs(bed.displacement).max(axis=1) > 0).astype(np.int32)
    start = own.surface.vertices - own.displacement
    assert len(start)
    ball_path = BodyPath(still, share * own.position, np.zeros(0, np.int32), np.zeros((COUNT, 0, 3), np.float32))
    dent = (share[:, :, None] * bed.displacement[moved]).astype(np.float32)
    bed_path = BodyPath(still, np.zeros((COUNT, 3)), moved, dent)
    return replace(settled(), frames=DropFrames(np.linspace(0.0, 1.0, COUNT), (ball_path, bed_path)))


def test_the_scene_follows_each_frame():
    scene = MovingScene(scene_of(), moving(), "bed")
    end = settled_scene(scene_of(), settled(), "bed")
    assert scene.at(0).vertices == pytest.approx(end.start.vertices, abs=1e-9)
    assert scene.at(COUNT - 1).vertices == pytest.approx(end.scene.mesh.vertices, abs=1e-5)
    depth = [scene.at(frame).vertices[:, 2] - end.start.vertices[:, 2] for frame in range(COUNT)]
    assert [round(float(one.min()), 3) for one in depth] == [-0.0, -0.01, -0.02, -0.03]


def test_a_thing_that_was_placed_before_moves_with_its_own_body():
    """A crate beside the ball that slides by 4 cm in all."""
    crate = box_mesh((0.3, -0.1, 0.5), (0.5, 0.1, 0.7))
    scene = scene_of(crate=crate)
    own = next(one for one in scene.instances if one.id == "crate")
    known = replace(scene, instances=tuple(replace(one, placed=one is own) for one in scene.instances))
    slide = np.array([0.04, 0.0, 0.0])
    end = Mesh(crate.vertices + slide, crate.faces, crate.colors)
    body = SettledBody("crate", end, slide, np.array([1.0, 0, 0, 0]), np.tile(slide, (len(crate.vertices), 1)))
    share = np.linspace(0.0, 1.0, COUNT)[:, None]
    path = BodyPath(np.tile(np.eye(3), (COUNT, 1, 1)), share * slide, np.zeros(0, np.int32),
                    np.zeros((COUNT, 0, 3), np.float32))  # fmt: skip
    told = moving()
    assert told.frames is not None
    frames = replace(told.frames, bodies=(*told.frames.bodies, path))
    film = MovingScene(known, replace(told, bodies=(*told.bodies, body), frames=frames), "bed")
    mine = np.unique(film.start.faces[film.around.scene.face_instance == known.index_of("crate")])
    for frame in range(COUNT):
        moved = film.at(frame).vertices[mine] - film.start.vertices[mine]
        assert moved == pytest.approx(np.tile(share[frame] * slide, (len(mine), 1)), abs=1e-9)


def test_pictures_of_a_drop():
    camera = looking_at(np.array([0.3, -0.8, 0.9]), np.array([0.0, 0.0, 0.55]), 64, 64, fov_deg=40.0)
    pictures = list(
        drop_pictures(scene_of(), ball(), anchor(), moving(), (PLAIN, PLAIN), camera, RenderConfig(size=64, samples=1))
    )
    assert len(pictures) == COUNT
    red = [(one[..., 0].astype(int) - one[..., 1] > 60) for one in pictures]
    rows = [np.flatnonzero(one.any(axis=1)).mean() for one in red]
    assert rows == sorted(rows)  # it comes down
    assert rows[-1] > rows[0]


def test_long_drops_are_thinned_to_both_ends():
    path = moving().frames
    assert path is not None
    long = replace(moving(), frames=replace(path, time=np.arange(90.0)))
    chosen = chosen_frames(long)
    assert len(chosen) == MOST_PICTURES
    assert chosen[[0, -1]].tolist() == [0, 89]
