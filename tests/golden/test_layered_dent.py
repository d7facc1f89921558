"""The finite elements that golden placements are compared with, against stored solutions of others."""

from math import pi

import layered_dent
import pytest
from layered_dent import Layer, dent, disc_sink

from dcap.scene.types.particles import GRAVITY

OUTER = 0.4 / pi**0.5
"""Radius [m] of the disc that has the area of a slab 0.4 x 0.4 m."""
FOAM, COVER = Layer(0.15, 2e4, 0.3), [Layer(0.02, 1.2e4, 0.2), Layer(0.23, 4e4, 0.3)]


@pytest.mark.slow
@pytest.mark.parametrize(("layers", "expected"), [([FOAM], 0.012161), (COVER, 0.012547)])
def test_dents_are_those_of_other_finite_elements(layers: list[Layer], expected: float) -> None:
    """A ball of 5 cm and 1 kg on a slab and on a cover on foam, sides free: static solutions with 27-node hexahedra and
    their axisymmetric kin, good to 0.02 mm."""
    found = dent(layers, OUTER, 0.05, GRAVITY, guess=0.012, cell=0.004, held=False)
    assert found == pytest.approx(expected, rel=0.004)


def test_a_dent_that_is_not_found_is_an_error(monkeypatch: pytest.MonkeyPatch) -> None:
    """A depth at which the ball carries another load is no reference."""
    monkeypatch.setattr(layered_dent, "SECANTS", 1)
    with pytest.raises(AssertionError, match="after 1 steps"):
        dent([FOAM], OUTER, 0.05, GRAVITY, guess=0.003, cell=0.02, held=False)


@pytest.mark.parametrize("stiff", [False, True])
def test_a_disc_sinks_into_deep_ground_as_closed_forms_say(stiff: bool) -> None:
    """P (1 - nu^2) / (2 E a) if it is stiff [J85, 3.36], 16 / (3 pi^2) P (1 - nu^2) / (E a) on average if it presses
    evenly [J85, 3.29].

    Ground of R = 100 a gives about a / R less, and cells of a / 20 let a stiff disc, whose pressure is singular at the
    rim, sink 1.2 % less than cells of half that size and again that much less than none: 2 % and 1 % are seen.
    [J85] Johnson: Contact Mechanics. 1985.
    """
    e, nu, radius = 2e4, 0.3, 0.05
    ground = [Layer(100.0 * radius, e, nu)]
    found = disc_sink(ground, 100.0 * radius, radius, 1.0, across=20, held=False, stiff=stiff)
    factor = 0.5 if stiff else 16.0 / (3.0 * pi**2)
    assert found == pytest.approx(factor * (1.0 - nu**2) / (e * radius), rel=0.03)


@pytest.mark.parametrize("stiff", [False, True])
def test_a_wide_disc_on_a_thin_layer_presses_it_without_bulging(stiff: bool) -> None:
    """P h / (A M) with the confined modulus M, but for a rim of about the thickness."""
    layer, wide = Layer(0.02, 2e4, 0.3), 2.0
    confined = 2e4 * 0.7 / (1.3 * 0.4)
    found = disc_sink([layer], wide + 0.2, wide, 1.0, across=300, held=False, stiff=stiff)
    assert found == pytest.approx(0.02 / (confined * pi * wide**2), rel=2.0 * 0.02 / wide)
