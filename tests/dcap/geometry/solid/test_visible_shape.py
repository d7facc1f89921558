"""An open or one-sided object becomes the solid that it looks like, or is refused with its holes."""

import numpy as np
import pytest
from torn import ball, fine_box, middles, normals, scrap, turned, where

from dcap.geometry.pieces import signed_volume
from dcap.geometry.solid.soundness import agreement, moved, well_formed
from dcap.geometry.solid.visible_shape import VisibleShape, visible_shape
from dcap.scene.types.mesh import Mesh

R = 0.1
BALL = ball(R)
FULL = 4.0 / 3.0 * np.pi * R**3
BLOCK = fine_box((-0.04, -0.04, 0.0), (0.04, 0.04, 0.1), 4)
CUP = where(BLOCK, normals(BLOCK)[:, 2] < 0.5)


def volume(shape: VisibleShape, given: Mesh) -> float:
    """Of the solid [m^3], which is sound and where the given faces are."""
    assert shape.mesh is not None
    assert well_formed(shape.mesh)
    assert agreement(shape.mesh) > 0.999
    assert moved(given, shape.mesh)[0] < 1e-4
    return signed_volume(shape.mesh.vertices, shape.mesh.faces)


def test_a_shell_without_underside_is_closed_by_its_rim() -> None:
    """Half a ball (of 1280 faces, 0.5 % less than round) is half a ball, not a bowl."""
    dome = where(BALL, middles(BALL)[:, 2] > 0.0)
    found = visible_shape(dome, vessel=False)
    assert volume(found, dome) == pytest.approx(0.5 * FULL, rel=0.03)
    assert any("20 x 20 cm below, closed from the rim" in note for note in found.notes)


@pytest.mark.parametrize("vessel", [True, None])
def test_a_one_sided_cup_gets_walls(vessel: bool | None) -> None:
    """2 % of its height, 2 mm: area of its skin times that, the corners counted once more or less. A thing without a
    name is one if it opens upwards and is deep."""
    skin = float(CUP.face_areas.sum())
    found = visible_shape(CUP, vessel=vessel)
    assert volume(found, CUP) == pytest.approx(0.002 * skin, rel=0.08)


def test_what_is_no_vessel_is_filled() -> None:
    """The same skin named as a block."""
    assert volume(visible_shape(CUP, vessel=False), CUP) == pytest.approx(0.08 * 0.08 * 0.1, rel=1e-6)


def test_a_tube_gets_walls() -> None:
    """Open at both ends it is no solid ball's slice."""
    tube = where(BALL, np.abs(middles(BALL)[:, 2]) < 0.05)
    assert volume(visible_shape(tube, vessel=False), tube) < 0.2 * FULL


def test_a_sheet_gets_a_thickness() -> None:
    """2 % of its size, at most 5 mm."""
    sheet = where(fine_box((0, 0, 0), (0.5, 0.4, 0.1), 4), normals(fine_box((0, 0, 0), (0.5, 0.4, 0.1), 4))[:, 2] > 0.5)
    assert volume(visible_shape(sheet, vessel=False), sheet) == pytest.approx(0.5 * 0.4 * 0.005, rel=1e-6)


def test_scraps_go_and_patches_are_turned() -> None:
    """The ball is left."""
    flawed = Mesh.concatenate([turned(BALL, middles(BALL)[:, 0] > 0.04), scrap((0.0, 0.0, 0.2))])
    found = visible_shape(flawed, vessel=False)
    assert volume(found, BALL) == pytest.approx(FULL, rel=0.02)
    assert any("scraps" in note for note in found.notes)
    assert any("inside out" in note for note in found.notes)


@pytest.mark.parametrize("axis", [0, 2])
def test_sheets_inside_a_closed_shell_are_left_out(axis: int) -> None:
    """A ball with a disc across its middle, of one side or of two, and a partition on that: modellers leave such faces.
    What is left is the ball, exactly."""
    disc = Mesh.of(*across(axis))
    back = Mesh.of(disc.vertices, disc.faces[:, ::-1])
    half = where(disc, middles(disc)[:, 1] > 0.0)
    upright = Mesh.of(np.roll(half.vertices, 1, axis=1), half.faces)
    for sheets in ([disc], [disc, back], [disc, upright]):
        whole = Mesh.concatenate([BALL, *sheets])
        found = visible_shape(whole, vessel=None)
        assert volume(found, BALL) == pytest.approx(signed_volume(BALL.vertices, BALL.faces), rel=1e-9)
        assert found.notes == (
            f"{len(whole.faces) - len(BALL.faces)} faces inside it, which nothing is seen of, are left out",
        )


def across(axis: int) -> tuple[np.ndarray, np.ndarray]:
    """A disc just within the ball, across an axis: vertices and faces."""
    angle = np.linspace(0.0, 2.0 * np.pi, 24, endpoint=False)
    rim = 0.97 * R * np.stack([np.cos(angle), np.sin(angle), np.zeros(24)], axis=1)
    ring = np.arange(24)
    faces = np.stack([np.full(24, 24), ring, (ring + 1) % 24], axis=1)
    return np.roll(np.concatenate([rim, np.zeros((1, 3))]), axis - 2, axis=1), faces


def test_sheets_behind_an_opening_stay() -> None:
    """In half of a ball the disc is seen: nobody left it in by mistake."""
    dome = where(BALL, middles(BALL)[:, 2] > 0.0)
    found = visible_shape(Mesh.concatenate([dome, Mesh.of(*across(0))]), vessel=False)
    assert not any("inside it" in note for note in found.notes)


@pytest.mark.slow
@pytest.mark.long
def test_a_soup_is_meshed_anew() -> None:
    """Faces that share no vertex, 0.3 mm off their neighbours: the volume is that of the ball."""
    noise = np.random.default_rng(0).normal(0.0, 1e-4, (len(BALL.faces), 3, 3))
    soup = Mesh.of((BALL.triangles + noise).reshape(-1, 3), np.arange(3 * len(BALL.faces)).reshape(-1, 3))
    found = visible_shape(where(soup, np.arange(len(soup.faces)) % 40 != 0), vessel=False)
    assert found.mesh is not None
    assert signed_volume(found.mesh.vertices, found.mesh.faces) == pytest.approx(FULL, rel=0.03)


def test_strips_that_do_not_touch_are_refused_with_their_holes() -> None:
    """Nobody knows what is between them."""
    strips = where(BALL, np.floor((middles(BALL)[:, 2] + R) / 0.02) % 3 == 0)
    found = visible_shape(strips, vessel=False)
    assert found.mesh is None
    assert "do not touch" in found.notes[0]
    assert found.holes[0].size == pytest.approx((0.2, 0.2), abs=0.01)


def test_a_thin_hoop_of_a_ball_is_no_ball() -> None:
    """Of what is known to be no vessel four fifths would be a guess; of what nobody knows it is a hoop with walls."""
    hoop = where(BALL, np.abs(middles(BALL)[:, 2]) < 0.012)
    found = visible_shape(hoop, vessel=False)
    assert found.mesh is None
    assert "would be a guess" in found.notes[0]
    assert len(found.holes) == 2
    assert visible_shape(hoop, vessel=None).mesh is not None


def test_parts_that_only_touch_where_they_are_open_hang_together() -> None:
    """A chain of three balls without undersides, each met by its neighbour's missing side only: one solid."""
    dome = where(BALL, middles(BALL)[:, 2] > 0.0)
    chain = [Mesh.of(dome.vertices + np.array([0.0, 0.0, 1.01 * R * step]), dome.faces) for step in range(3)]
    found = visible_shape(Mesh.concatenate(chain), vessel=False)
    assert found.mesh is not None
    assert signed_volume(found.mesh.vertices, found.mesh.faces) == pytest.approx(1.5 * FULL, rel=0.05)


def test_only_open_pieces_are_told_as_such() -> None:
    """Three closed balls and two shells of about their size, all apart."""
    dome = where(BALL, middles(BALL)[:, 2] > -0.05)
    apart = [
        Mesh.of(one.vertices + np.array([0.3 * step, 0.0, 0.0]), one.faces)
        for step, one in enumerate([BALL] * 3 + [dome] * 2)
    ]
    found = visible_shape(Mesh.concatenate(apart), vessel=False)
    assert found.mesh is None
    assert found.notes[0].startswith("it has 2 open pieces that do not touch")


NOTHING = np.zeros((0, 3))
LINE = np.array([[0, 0, 0], [0, 0, 1], [0, 0, 2.0]])


@pytest.mark.parametrize(("points", "faces"), [(NOTHING, NOTHING), (LINE, [[0, 1, 2]]), (LINE, [[0, 1, 1]])])
@pytest.mark.parametrize("vessel", [True, False, None])
def test_what_has_no_area_is_refused(points: np.ndarray, faces: np.ndarray, vessel: bool | None) -> None:
    """It has no solid."""
    found = visible_shape(Mesh.of(points, np.asarray(faces)), vessel=vessel)
    assert found.mesh is None
    assert found.notes == ("its surface has no area",)


def test_faces_without_area_change_nothing() -> None:
    """A ball with a line on it."""
    line = Mesh.of(LINE * 0.01 + (0.0, 0.0, R), [[0, 1, 2], [0, 1, 1]])
    found = visible_shape(Mesh.concatenate([BALL, line]), vessel=False)
    assert volume(found, BALL) == pytest.approx(FULL, rel=0.01)
