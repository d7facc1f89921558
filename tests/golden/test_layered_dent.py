"""The finite elements that golden placements are compared with, against stored solutions of others."""

import pytest
from layered_dent import Layer, dent

from dcap.scene.types.gravity import GRAVITY

OUTER = 0.4 / 3.141592653589793**0.5
"""Radius [m] of the disc that has the area of a slab 0.4 x 0.4 m."""
FOAM, COVER = Layer(0.15, 2e4, 0.3), [Layer(0.02, 1.2e4, 0.2), Layer(0.23, 4e4, 0.3)]


@pytest.mark.slow
@pytest.mark.parametrize(("layers", "expected"), [([FOAM], 0.012161), (COVER, 0.012547)])
def test_dents_are_those_of_other_finite_elements(layers: list[Layer], expected: float) -> None:
    """A ball of 5 cm and 1 kg on a slab and on a cover on foam, sides free: static solutions with 27-node hexahedra and
    their axisymmetric kin, good to 0.02 mm."""
    found = dent(layers, OUTER, 0.05, GRAVITY, guess=0.012, cell=0.004, held=False)
    assert found == pytest.approx(expected, rel=0.004)
