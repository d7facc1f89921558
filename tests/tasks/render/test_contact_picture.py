"""The contact picture stays readable on dark things."""

import numpy as np
import pytest

from tasks.render.contact_picture import LEAST_GREY, lightened


@pytest.mark.parametrize("level", [4.0, 30.0, 100.0])
def test_a_dark_scene_is_lightened_in_order(level: float) -> None:
    """The middle becomes readable; black and white stay, and what was lighter stays lighter."""
    rgb = np.linspace(0.0, 2.0 * level, 101)[:, None, None] * np.ones((1, 4, 3))
    scene = np.ones((101, 4), dtype=bool)
    found = lightened(rgb, scene)
    assert np.median(found) == pytest.approx(LEAST_GREY, abs=0.5)
    assert found[0].max() == 0.0
    assert (np.diff(found[:, 0, 0]) > 0.0).all()
    assert found.max() <= 255.0
