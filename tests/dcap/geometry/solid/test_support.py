"""The solid of supports that were seen from above only."""

import numpy as np
import pytest

from dcap.geometry.solid.support import carried_bottoms, shell_bottoms, support_solid
from dcap.scene.types.boxes import OrientedBox
from dcap.scene.types.mesh import Mesh

REGION = np.array([[-0.5, -0.5, -1.0], [0.5, 0.5, 1.0]])


def plate(low: tuple[float, float], high: tuple[float, float], z: float, noise: float = 0.0, count: int = 25) -> Mesh:
    """A sheet seen from above, with noise in its height."""
    x, y = np.meshgrid(np.linspace(low[0], high[0], count), np.linspace(low[1], high[1], count), indexing="ij")
    height = z + noise * np.random.default_rng(0).standard_normal(x.shape)
    corner = np.arange(count * count).reshape(count, count)
    a, b, c, d = (corner[s].ravel() for s in (np.s_[:-1, :-1], np.s_[1:, :-1], np.s_[1:, 1:], np.s_[:-1, 1:]))
    return Mesh.of(
        np.stack([x, y, height], -1).reshape(-1, 3), np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    )


def box(low: tuple[float, float, float], high: tuple[float, float, float]) -> OrientedBox:
    """An upright box."""
    a, b = np.array(low), np.array(high)
    return OrientedBox((a + b) / 2, np.eye(3), (b - a) / 2)


def test_a_noisy_mattress_seen_from_above_is_a_block() -> None:
    """A sheet with 2 mm of noise and a hole is solid down to its bottom everywhere, and nowhere else."""
    sheet = plate((-0.4, -0.4), (0.4, 0.4), 0.5, noise=0.002)
    middle = np.linalg.norm(sheet.triangles.mean(axis=1)[:, :2], axis=1)
    pricked = sheet.submesh(np.flatnonzero(middle > 0.03))
    solid = support_solid(pricked, np.full(len(pricked.faces), 0.3), REGION, hole_perimeter=0.6)
    grid = np.stack(np.meshgrid(*[np.linspace(-0.38, 0.38, 20)] * 2, [0.305, 0.4, 0.49], indexing="ij"), -1).reshape(
        -1, 3
    )
    assert solid.inside(grid).all()
    outside = grid.copy()
    outside[:, 2] = np.where(grid[:, 2] < 0.4, 0.29, 0.51)
    assert not solid.inside(outside[grid[:, 2] != 0.4]).any()
    # beneath the middle of a sheet the nearest surface is the sheet or the bottom
    assert solid(np.array([[0.2, 0.2, 0.4]]))[0] == pytest.approx(-0.1, abs=0.008)


def test_two_parts_over_one_bottom_have_no_wall_between_them() -> None:
    """Walls between neighbours cancel: deep inside, the distance is that to the outside, not to the seam."""
    left, right = plate((-0.4, -0.4), (0.0, 0.4), 0.5), plate((0.0, -0.4), (0.4, 0.4), 0.5)
    both = Mesh.concatenate([left, right])
    solid = support_solid(both, np.full(len(both.faces), 0.3), REGION, 0.0)
    assert solid(np.array([[0.0, 0.0, 0.4]]))[0] == pytest.approx(-0.1, abs=1e-6)


def test_what_lies_under_a_pillow_is_what_carries_it() -> None:
    """Bottoms follow the chain pillow, blanket, mattress; a lamp beside the bed keeps its own."""
    mattress = box((-0.8, -1.0, 0.3), (0.8, 1.0, 0.5))
    blanket = box((-0.8, -1.0, 0.45), (0.8, 0.4, 0.53))
    pillow = box((-0.3, 0.0, 0.52), (0.3, 0.4, 0.64))
    lamp = box((1.0, 0.0, 0.5), (1.2, 0.2, 0.9))
    assert carried_bottoms([pillow, lamp, mattress, blanket]).tolist() == pytest.approx([0.3, 0.5, 0.3, 0.3])


def test_a_shelf_of_sheets_stays_open_between_its_boards() -> None:
    """Each board seen from above only becomes a board: 3 cm thick, with room for a book below the next."""
    boards = Mesh.concatenate([plate((-0.4, -0.2), (0.4, 0.2), z) for z in (0.2, 0.6, 1.0)])
    bottom = shell_bottoms(boards, np.full(len(boards.faces), 0.2), 0.03)
    assert np.unique(bottom).tolist() == pytest.approx([0.17, 0.57, 0.97])
    solid = support_solid(boards, bottom, REGION, 0.25)
    assert solid.inside(np.array([[0, 0, 0.19], [0, 0, 0.58], [0.3, 0.1, 0.98]])).all()
    assert not solid.inside(np.array([[0, 0, 0.4], [0, 0, 0.8], [0, 0, 1.01], [0, 0, 0.1]])).any()


def test_a_table_top_is_solid_to_the_bottom_of_its_part() -> None:
    """A part whose sides are seen keeps its own depth: the shell is only for sheets."""
    top = plate((-0.4, -0.2), (0.4, 0.2), 0.8)
    rim = np.array([[-0.4, -0.2, 0.7], [0.4, -0.2, 0.7], [0.4, -0.2, 0.8]])
    mesh = Mesh.concatenate([top, Mesh.of(rim, [[0, 1, 2]])])
    assert np.allclose(shell_bottoms(mesh, np.full(len(mesh.faces), 0.7), 0.03), 0.7)
