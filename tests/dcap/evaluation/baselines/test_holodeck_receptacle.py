"""Holodeck's places on a receptacle: what fits, what is laid flat, what is free."""

import numpy as np
import pytest
from box_rooms import ROOM, ball, block, segmentation

from dcap.evaluation.baselines.floor_plan import CanonicalAsset, canonical_asset, floor_plan_of
from dcap.evaluation.baselines.holodeck.receptacle import (
    collides,
    fits_on,
    is_small,
    is_thin,
    laid_flat,
    point_on,
    receptacle_place,
    upward_faces,
)
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.segmentation import Segmentation

RNG_SEEDS = range(8)


def asset(mesh: Mesh) -> CanonicalAsset:
    """It, as it is."""
    return canonical_asset(mesh, 1.0, "object")


def cabinet() -> Segmentation:
    """A table of 1 x 0.6 m, 0.5 m high, with a board 0.2 m above its left half and a vase on its right."""
    return segmentation(
        {
            "table": ("table", None, [("top", block((0, 0, 0.4), (1, 0.6, 0.5))),
                                      ("board", block((0, 0, 0.7), (0.5, 0.6, 0.72)))]),
            "vase": ("vase", None, [("body", block((0.7, 0.2, 0.5), (0.8, 0.3, 0.9)))]),
            "floor": ("floor", None, [("floor", block((-2, -2, -0.1), (3, 3, 0.0)))]),
        }
    )  # fmt: skip


def test_only_what_is_smaller_than_90_percent_fits() -> None:
    """On 1 x 0.6 m: 0.89 x 0.53 m fits, 0.91 x 0.53 m and 0.89 x 0.55 m do not, whichever way round."""

    def fits(length: float, width: float) -> bool:
        return fits_on(asset(block((0, 0, 0), (length, width, 0.1))), np.array([1.0, 0.6]))

    assert fits(0.89, 0.53)
    assert fits(0.53, 0.89)
    assert not fits(0.91, 0.53)
    assert not fits(0.89, 0.55)


def test_thin_things_are_laid_flat() -> None:
    """A standing book, 3 cm thick along x or y, ends 3 cm high; one of 4 cm, and one that lies, are left alone."""
    for size, height in (((0.03, 0.2, 0.3), 0.03), ((0.2, 0.03, 0.3), 0.03), ((0.04, 0.2, 0.3), 0.3),
                         ((0.2, 0.3, 0.03), 0.03)):  # fmt: skip
        turned = np.abs(laid_flat(np.array(size)) @ np.array(size))
        assert turned[2] == pytest.approx(height)
        assert np.linalg.det(laid_flat(np.array(size))) == pytest.approx(1.0)


def test_things_thinner_than_5_cm_are_thin() -> None:
    """Along x or y; how high they are does not count."""
    assert is_thin(np.array([0.04, 0.3, 0.3]))
    assert is_thin(np.array([0.3, 0.04, 0.3]))
    assert not is_thin(np.array([0.05, 0.3, 0.01]))


def test_small_things_get_a_random_turn() -> None:
    """At most 25 cm in every direction."""
    assert is_small(np.array([0.25, 0.25, 0.25]))
    assert not is_small(np.array([0.26, 0.1, 0.1]))
    assert not is_small(np.array([0.1, 0.1, 0.26]))


def test_points_are_on_faces_that_look_up() -> None:
    """All lie on the table's top or on the board; both get their share of the area (0.6 and 0.3 m2)."""
    scene, rng = cabinet(), np.random.default_rng(0)
    points = np.array([point_on(scene, upward_faces(scene, 0), rng) for _ in range(300)])
    on_top, on_board = np.isclose(points[:, 2], 0.5), np.isclose(points[:, 2], 0.72)
    assert (on_top | on_board).all()
    # binomial: 200 +- 3 * sqrt(300 * 2 / 9)
    assert abs(int(on_top.sum()) - 200) < 3.0 * np.sqrt(300.0 * 2.0 / 9.0)


@pytest.mark.parametrize("seed", RNG_SEEDS)
def test_a_place_is_over_the_receptacle_and_free(seed: int) -> None:
    """A 12 x 8 x 15 cm box stands 1 mm above the top or the board, all of it over them, and not in the vase."""
    scene, one = cabinet(), asset(block((0, 0, 0), (0.12, 0.08, 0.15)))
    found = receptacle_place(scene, 0, one, np.random.default_rng(seed), 50)
    assert found is not None
    low, high = one.mesh.transformed(one_pose(one, found.center, found.yaw)).bounds
    assert low[2] == pytest.approx(0.501, abs=1e-4) or low[2] == pytest.approx(0.721, abs=1e-4)
    right = 1.0 if low[2] < 0.6 else 0.5
    # the outermost rays lie at 98 % of the half extents
    assert (low[:2] > -0.003).all()
    assert high[0] < right + 0.003
    assert high[1] < 0.603
    in_vase = low[0] < 0.8 and high[0] > 0.7 and low[1] < 0.3 and high[1] > 0.2
    assert not in_vase or low[2] > 0.9 or found.yaw % (np.pi / 2) > 1e-9  # bounds of what is turned are wider


def one_pose(one: CanonicalAsset, center: np.ndarray, yaw: float) -> np.ndarray:
    """World from the canonical mesh."""
    return one.pose(center, yaw) @ np.linalg.inv(one.canonical_from_object)


def test_what_is_too_high_for_the_gap_goes_on_top_or_not_at_all() -> None:
    """A box 0.3 m high never stands under the board that is 0.2 m above the table."""
    scene, one = cabinet(), asset(block((0, 0, 0), (0.1, 0.1, 0.3)))
    for seed in RNG_SEEDS:
        found = receptacle_place(scene, 0, one, np.random.default_rng(seed), 50)
        assert found is not None
        assert found.center[0] > 0.5 or found.center[2] > 0.72


def test_under_a_pillow_is_no_place() -> None:
    """A coin on the bed lies on mattress or pillow, never on the mattress inside the pillow's surface."""
    coin = asset(block((0, 0, 0), (0.02, 0.02, 0.002)))
    index = ROOM.index_of("bed")
    for seed in range(40):
        found = receptacle_place(ROOM, index, coin, np.random.default_rng(seed), 20)
        assert found is not None
        x, y, z = found.center
        on_pillow = 0.5 < y < 0.9 and 0.05 < abs(x) < 0.65
        assert not on_pillow or z > 0.62


def test_the_same_seed_gives_the_same_place_and_no_room_gives_none() -> None:
    """Deterministic; a thing as large as the table does not fit with the vase on it."""
    scene = cabinet()
    one, two = (receptacle_place(scene, 0, asset(ball(0.05)), np.random.default_rng(1), 10) for _ in range(2))
    assert one is not None
    assert two is not None
    np.testing.assert_array_equal(one.center, two.center)
    assert receptacle_place(scene, 0, asset(block((0, 0, 0), (0.85, 0.5, 0.3))), np.random.default_rng(1), 10) is None


def test_boxes_on_the_same_receptacle_must_not_meet() -> None:
    """A box that meets the vase's is told so; one beside it, and one in the table itself, are not."""
    plan = floor_plan_of(cabinet())
    assert collides(plan, "table", np.array([0.65, 0.15, 0.5]), np.array([0.75, 0.25, 0.6])) == "vase"
    assert collides(plan, "table", np.array([0.85, 0.15, 0.5]), np.array([0.95, 0.25, 0.6])) == ""
    assert collides(plan, "table", np.array([0.1, 0.1, 0.45]), np.array([0.2, 0.2, 0.55])) == ""
    assert collides(plan, "floor", np.array([0.1, 0.1, 0.45]), np.array([0.2, 0.2, 0.55])) == ""
