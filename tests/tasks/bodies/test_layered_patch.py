"""What a contact feels of layers."""

import numpy as np
import pytest

from tasks.bodies.plan_contact import felt_compliance, layered_patch

SOFT, HARD = 1e-4, 1e-6


def test_a_contact_feels_a_thin_layer_little_and_a_thick_one_alone() -> None:
    """Between those limits both count; one layer counts as itself."""
    assert felt_compliance([(0.1, SOFT)], 0.02) == pytest.approx(SOFT)
    assert felt_compliance([(1e-6, HARD), (1.0, SOFT)], 0.02) == pytest.approx(SOFT, rel=1e-3)
    assert felt_compliance([(10.0, SOFT), (1.0, HARD)], 0.02) == pytest.approx(SOFT, rel=1e-2)
    assert HARD < felt_compliance([(0.01, SOFT), (1.0, HARD)], 0.02) < SOFT


def test_a_patch_on_a_thin_soft_layer_is_narrower_than_on_a_thick_one() -> None:
    """A ball on foam over a rigid floor: the floor is felt, the more so the thinner the foam."""
    x = np.linspace(-0.05, 0.05, 64)
    gap, spacing = (x[:, None] ** 2 + x[None, :] ** 2) / 0.2, (x[1] - x[0], x[1] - x[0])
    widths = [
        layered_patch(gap, spacing, 2.0, ([(np.inf, 0.0)], [(depth, SOFT), (np.inf, 0.0)])).touching.sum()
        for depth in (0.005, 0.02, 10.0)
    ]
    assert widths[0] < widths[1] < widths[2]
