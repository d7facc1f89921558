"""Where a body has parts, each has its own friction and rolling resistance."""

from dataclasses import replace

import numpy as np
import pytest

from solver.config import SolverConfig
from solver.errors import ModelError
from solver.model.bodies import Model
from solver.settle import settle


def halves(body, left, right):
    """A body whose faces have other rows of friction where their middle has negative x than elsewhere."""
    middle = body.vertices[body.faces].mean(axis=1)
    return replace(body, face_friction=np.where(middle[:, :1] < 0.0, left, right))


def tilted(lab, angle):
    """Gravity as felt on a floor that runs down along y."""
    return lab.gravity * np.array([0.0, np.sin(angle), -np.cos(angle)])


@pytest.mark.parametrize(
    ("kind", "method"),
    [("rigid", "tl"), ("soft", "tl"), pytest.param("soft", "mls", marks=pytest.mark.slow)],
)
def test_a_block_slides_on_the_slippery_part_alone(lab, kind, method):
    """One floor at 0.2, of friction 0.6 and 0.05 on its two sides: what lies on the rough one stays, the other goes."""
    rough, slippery = [0.6, 0.5, 0.0], [0.05, 0.04, 0.0]
    floor = halves(lab.floor(mu=(0.6, 0.5)), rough, slippery)
    ends = []
    for x in (-0.15, 0.15):
        if kind == "rigid":
            block = lab.rigid("block", lab.Box(np.full(3, 0.1)), [x, 0, 0.0501], mu=(0.6, 0.5), edge=0.025)
        else:
            block = lab.soft(
                "block", lab.Box(np.full(3, 0.1)), [x, 0, 0.0502], E=1e6, rho=300.0, cell=0.025, mu=(0.6, 0.5)
            )
        result = lab.drop(block, floor, gravity=tilted(lab, 0.2), step_limit=60, method=method)
        ends.append(abs(result.bodies[0].translation[1]))
    assert ends[0] < 2e-3
    assert ends[1] > 0.05


def test_own_parts_count_too(lab):
    """A block with one slippery foot on a floor of one friction: the limit is that of each foot under its load."""
    block = lab.rigid("block", lab.Box(np.array([0.2, 0.1, 0.05])), [0, 0, 0.0251], mu=(0.8, 0.8), edge=0.025)
    two = halves(block, [0.8, 0.8, 0.0], [0.2, 0.2, 0.0])
    floor = lab.floor(mu=(0.8, 0.8))
    # geometric means with the floor: 0.8 and 0.4; half the weight on each side: 0.6 in all
    stays, goes = (
        settle(Model((two, floor), tilted(lab, np.arctan(mu))), SolverConfig(threads=2, step_limit=60)).bodies[0]
        for mu in (0.5, 0.75)
    )
    assert abs(stays.translation[1]) < 2e-3
    assert abs(goes.translation[1]) > 0.01


def test_rolling_resistance_is_that_of_the_place(lab):
    """A ball rolls from a part without resistance and stops on one with it; the certificate names the lever there."""
    ball = lab.rigid("ball", lab.Capsule(0.03, 0.0), [0.05, 0, 0.0301], mass=0.2, rolling=2e-3, edge=0.006,
                     velocity=np.array([-0.15, 0.0, 0.0]))  # fmt: skip
    floor = halves(lab.floor(), [0.5, 0.4, 2e-3], [0.5, 0.4, 0.0])
    result = lab.drop(ball, floor)
    assert result.verdict == "at_rest"
    assert result.bodies[0].vertices[:, 0].mean() < -0.005
    assert result.certificate.rolling_resistance[0].limit_length_m == pytest.approx(2e-3)


def test_one_row_for_all_points_is_the_bodys_own_friction(lab):
    """The same bytes with the same number at every point."""
    block = lab.rigid("block", lab.Box(np.full(3, 0.1)), [0, 0, 0.0501], edge=0.025)
    floor = lab.floor()
    rows = np.tile([[0.5, 0.4, 0.0]], (len(floor.faces), 1))
    plain = lab.drop(block, floor, gravity=tilted(lab, 0.3), step_limit=20)
    same = lab.drop(block, replace(floor, face_friction=rows), gravity=tilted(lab, 0.3), step_limit=20)
    assert np.array_equal(plain.bodies[0].vertices, same.bodies[0].vertices)


def test_rows_that_make_no_sense_are_refused(lab):
    """The body and what is wrong are named."""
    floor = lab.floor()
    with pytest.raises(ModelError, match="'floor': face_friction has shape"):
        replace(floor, face_friction=np.ones((3, 3)))
    with pytest.raises(ModelError, match="'floor': face_friction needs 0 <= dynamic <= static"):
        replace(floor, face_friction=np.tile([[0.3, 0.4, 0.0]], (len(floor.faces), 1)))


def test_the_face_that_a_point_lies_on_decides(lab):
    """A floor of two large triangles around a small rough plate in it: a block near the plate, whose vertices are the
    nearest, slides on the slippery floor all the same."""
    slippery, rough = [0.02, 0.02, 0.0], [1.0, 1.0, 0.0]
    plain = lab.floor()
    corners = np.array([[-0.3, -0.3, 0.0], [0.3, -0.3, 0.0], [0.3, 0.3, 0.0], [-0.3, 0.3, 0.0]])
    plate = np.array([[0.06, -0.01, -0.001], [0.08, -0.01, -0.001], [0.07, 0.01, -0.001]])
    floor = replace(
        plain, vertices=np.concatenate([corners, plate]), faces=np.array([[0, 1, 2], [0, 2, 3], [4, 5, 6]], np.int32),
        face_friction=np.array([slippery, slippery, rough]),
    )  # fmt: skip
    block = lab.rigid("block", lab.Box(np.full(3, 0.1)), [0, 0, 0.0501], mu=(1.0, 1.0), edge=0.025)
    found = lab.drop(block, floor, gravity=tilted(lab, 0.25), step_limit=40)  # sqrt(0.02) = 0.14 < tan 0.25
    assert abs(found.bodies[0].translation[1]) > 0.02


def test_a_point_between_two_parts_has_their_mean_by_area(lab):
    """Of equal rows it is that row to the bit; of two rows it is a quarter and three quarters where areas are so."""
    floor = lab.floor()
    same = replace(floor, face_friction=np.tile([[0.1, 0.07, 0.003]], (len(floor.faces), 1)))
    assert (same.friction_rows == [0.1, 0.07, 0.003]).all()
    tent = replace(
        floor, vertices=np.array([[0.0, 0, 0], [1, 0, 0], [0, 1, 0], [-3.0, 0, 0]]),
        faces=np.array([[0, 1, 2], [0, 2, 3]], np.int32), face_friction=np.array([[0.8, 0.4, 0.0], [0.4, 0.4, 0.0]]),
    )  # fmt: skip
    assert tent.friction_rows[:, 0] == pytest.approx([0.5, 0.8, 0.5, 0.4])
