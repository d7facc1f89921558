"""The independent referee on states whose outcome mechanics gives: what rests stays, what hovers falls, what is beside
its support tips, what is steep slides."""

import sys
from typing import Any

import numpy as np
import pytest
import trimesh

from dcap.evaluation.referee.rest import STEP, RestVerdict, Surroundings, judge_rest, overlap_depth
from dcap.scene.errors import GeometryError, InputError
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.particles import GRAVITY

TOP = 0.75
"""Of the table [m]."""
BOX = (0.2, 0.1, 0.1)
STAYS = 2e-5
"""What rests on plane faces may move [m]: contacts sink in by 1e-5 m (referee/rest.py)."""


def mesh(shape: trimesh.Trimesh, at: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> Mesh:
    return Mesh.of(shape.vertices + np.array(at), shape.faces)


def block(size: tuple[float, float, float], at: tuple[float, float, float]) -> Mesh:
    return mesh(trimesh.creation.box(size), at)


FLOOR, TABLE = block((6.0, 6.0, 0.1), (0.0, 0.0, -0.05)), block((1.0, 0.6, 0.04), (0.0, 0.0, TOP - 0.02))


def on_table(height: float, x: float = 0.0, **options: Any) -> RestVerdict:
    """A box so high over the table [m]."""
    thing = block(BOX, (x, 0.0, TOP + 0.5 * BOX[2] + height))
    return judge_rest(thing, Surroundings.of([FLOOR, TABLE], 0.5), 1.2, **options)


CORNERS = (
    (slice(None, -1), slice(None, -1)), (slice(1, None), slice(None, -1)),
    (slice(1, None), slice(1, None)), (slice(None, -1), slice(1, None)),
)  # fmt: skip


def height_field(height, half: float, count: int) -> Mesh:
    """A sheet over a square about the origin."""
    x, y = np.meshgrid(*[np.linspace(-half, half, count)] * 2, indexing="ij")
    index = np.arange(count**2).reshape(count, count)
    a, b, c, d = (index[corner].ravel() for corner in CORNERS)
    faces = np.concatenate([np.column_stack([a, b, c]), np.column_stack([a, c, d])])
    return Mesh.of(np.column_stack([x.ravel(), y.ravel(), height(x, y).ravel()]), faces)


def test_a_box_at_rest_stays():
    """On the table, which carries all of it; nothing overlaps."""
    found = on_table(0.0)
    assert found.drift_m < STAYS
    assert found.drift_deg < 1e-3
    assert (found.supported, found.carrier) == (True, 1)
    assert found.carried == pytest.approx([0.0, 1.0], abs=1e-3)
    assert found.penetration_m == pytest.approx(0.0, abs=1e-6)
    assert found.deviation_m == 0.0


@pytest.mark.parametrize("height", [5e-4, 2e-3, 9e-3])
def test_what_hovers_falls_by_its_gap(height: float):
    """It lands within a step of its fall, v dt, and does not bounce."""
    found = on_table(height)
    assert height <= found.drift_m + STAYS
    assert found.drift_m < height + np.sqrt(2.0 * GRAVITY * height) * STEP + STAYS
    assert found.supported


@pytest.mark.parametrize("depth", [2e-4, 3e-3])
def test_what_is_sunk_overlaps_and_comes_out(depth: float):
    """By its depth, and is not thrown: 2 % of the depth are left after four time constants, and nothing is above."""
    found = on_table(-depth)
    assert found.penetration_m == pytest.approx(depth, abs=1e-6)
    assert found.drift_m == pytest.approx(depth, rel=0.02, abs=STAYS)
    assert found.supported


@pytest.mark.parametrize(("share", "stays"), [(0.45, True), (0.6, False)])
def test_a_box_over_an_edge_tips_from_half_on(share: float, stays: bool):
    """A uniform box tips where its middle is beside the edge; then it lies on the floor."""
    found = on_table(0.0, 0.5 - 0.5 * BOX[0] + share * BOX[0])
    assert (found.drift_m < STAYS, found.drift_deg < 0.01, found.carrier == 1) == (stays, stays, stays)
    if not stays:
        assert found.drift_m > 0.5
        assert found.drift_deg > 90.0


@pytest.mark.parametrize(("degrees", "stays"), [(10.0, True), (25.0, True), (40.0, False)])
def test_a_box_on_a_slope_slides_beyond_the_angle_of_friction(degrees: float, stays: bool):
    """arctan 0.5 is 26.6 degrees; 40 degrees are a = g (sin - 0.5 cos), and a / 2 in a second."""
    angle = np.radians(degrees)
    turn = trimesh.transformations.rotation_matrix(angle, [0, 1, 0])
    slope, thing = block((3.5, 1.0, 0.1), (0.0, 0.0, -0.05)), block((0.1, 0.1, 0.02), (0.0, 0.0, 0.01))
    found = judge_rest(thing.transformed(turn), Surroundings.of([slope.transformed(turn)], 0.5), 1.0)
    if stays:
        assert found.drift_m < STAYS
    else:
        assert found.drift_m == pytest.approx(0.5 * GRAVITY * (np.sin(angle) - 0.5 * np.cos(angle)), rel=0.05)


@pytest.mark.slow
def test_a_ring_round_a_post_stays():
    """A hull of the ring would meet the post; it is not carried by it, and falls along it."""
    ring, post = trimesh.creation.annulus(0.05, 0.07, 0.03), mesh(trimesh.creation.cylinder(0.04, 0.3), (0, 0, 0.15))
    around = Surroundings.of([FLOOR, post], 0.5)
    lying = judge_rest(mesh(ring, (0.0, 0.0, 0.015)), around, 0.3)
    assert (lying.drift_m < STAYS, lying.carrier, lying.penetration_m) == (True, 0, pytest.approx(0.0, abs=1e-6))
    fallen = judge_rest(mesh(ring, (0.0, 0.0, 0.215)), around, 0.3)
    assert fallen.drift_m == pytest.approx(0.2, abs=2e-3)
    assert fallen.carrier == 0


@pytest.mark.slow
@pytest.mark.long
def test_a_ball_in_a_dent_of_its_shape_stays():
    """A patch of 2 cm around, of chords of 2 mm: they leave 2e-3^2 / (8 R) = 5e-6 m, the facets of the ball of 5 mm
    3e-5 m, and 4000 faces are within 1e-4 m of the bed."""
    radius, rim = 0.1, 0.02
    deep = np.sqrt(radius**2 - rim**2)

    def height(x, y):
        return np.where(x**2 + y**2 < rim**2, deep - np.sqrt(np.maximum(radius**2 - x**2 - y**2, 0.0)), 0.0)

    bed = height_field(height, 0.15, 151)
    ball = mesh(trimesh.creation.icosphere(4, radius), (0.0, 0.0, deep))
    found = judge_rest(ball, Surroundings.of([bed], 0.5), 5.0)
    assert found.drift_m < 1e-4
    assert found.supported
    assert found.deviation_m < 1e-4


@pytest.mark.slow
def test_a_ball_in_a_bowl_stays():
    """At the bottom of a sheet wound upwards, whose hull would lift it by 3 cm. It comes to lie on one of its facets of
    7 mm, half of one aside at most."""
    bowl = height_field(lambda x, y: (x**2 + y**2) / 0.3, 0.1, 41)
    ball = mesh(trimesh.creation.icosphere(3, 0.05), (0.0, 0.0, 0.05))
    found = judge_rest(ball, Surroundings.of([bowl], 0.5), 0.5)
    assert found.drift_m < 3.5e-3
    assert found.drift_deg < np.degrees(3.5e-3 / 0.05)
    assert found.supported


def test_what_is_over_nothing_falls():
    """g / 2 in a second, to the error of the steps g dt / 2."""
    found = judge_rest(block(BOX, (0.0, 0.0, 0.0)), Surroundings.of([block(BOX, (5.0, 0.0, 0.0))], 0.5), 1.0)
    assert found.drift_m == pytest.approx(0.5 * GRAVITY, abs=GRAVITY * STEP)
    assert (found.supported, found.carrier) == (False, -1)


def test_a_sheet_turned_upside_down_carries():
    """A floor whose one face looks down is taken as seen from above; so is one of two coinciding faces."""
    vertices = [(-1.0, -1.0, 0.0), (1.0, -1.0, 0.0), (1.0, 1.0, 0.0), (-1.0, 1.0, 0.0)]
    up, down = [(0, 1, 2), (0, 2, 3)], [(2, 1, 0), (3, 2, 0)]
    for faces in (up, down, up + down):
        found = judge_rest(block(BOX, (0.0, 0.0, 0.05)), Surroundings.of([Mesh.of(vertices, faces)], 0.5), 1.0)
        assert (found.drift_m < STAYS, found.supported) == (True, True), faces


def test_what_cannot_be_judged_is_said():
    """No mass; an object that encloses nothing."""
    around = Surroundings.of([FLOOR], 0.5)
    with pytest.raises(InputError, match="needs the mass"):
        judge_rest(block(BOX, (0.0, 0.0, 0.05)), around)
    with pytest.raises(GeometryError, match="encloses no volume"):
        judge_rest(Mesh.of(np.eye(3), [(0, 1, 2)]), around, 1.0)


def test_without_mujoco_a_line_says_what_to_install(monkeypatch: pytest.MonkeyPatch):
    """The extra."""
    monkeypatch.setitem(sys.modules, "mujoco", None)
    with pytest.raises(InputError, match=r"pip install dcap\[referee\]"):
        on_table(0.0)


def test_an_object_wholly_inside_a_solid_is_as_deep_as_it_lies() -> None:
    """A box of 10 cm in the middle of one of 1 m: each place on its surface is at most 45 cm from a face."""
    thing = block((0.1, 0.1, 0.1), (0.0, 0.0, 0.0))
    scene = block((1.0, 1.0, 1.0), (0.0, 0.0, 0.0))
    depth = overlap_depth(thing, scene, np.zeros(len(scene.faces), dtype=np.int64))
    assert depth == pytest.approx(0.45, abs=1e-6)
