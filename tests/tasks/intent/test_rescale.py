"""The factor of a mesh: kept where plausible, the unit's own where one fits, else the usual size."""

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from dcap.knowledge.lexicon import Thing, is_a, things
from dcap.synthetic.dataset import build_object
from dcap.synthetic.recipes import object_recipes
from tasks.intent.rescale import rescale

LIMITS = (1e-3, 1e3)
UNITS = {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254}
NEAREST = 0.999 * np.sqrt(2.54)
"""Inches and centimetres differ by 2.54: a thing further off its usual size than the root is nearer to the other."""
OBJECTS = sorted(one.id for one in things().values() if not is_a(one.id, "structure"))
TEXTILES = [
    "towel", "hand towel", "beach towel", "washcloth", "blanket", "throw blanket", "duvet", "sheet", "pillowcase",
    "sleeping bag", "tablecloth", "napkin", "handkerchief", "shirt", "t shirt", "trousers", "jacket", "coat", "scarf",
    "sock", "rug", "mat", "bath mat", "curtain", "yoga mat",
]  # fmt: skip


def decided(thing: Thing, extents: np.ndarray) -> tuple[float, str]:
    found = rescale(np.array(thing.sizes), extents, thing.spread, LIMITS)
    return found.scale, found.note


@pytest.mark.slow
@settings(max_examples=400, deadline=None)
@given(st.sampled_from(OBJECTS), st.integers(0, 2), st.floats(-1.0, 1.0), st.sampled_from(sorted(UNITS)), st.randoms())
def test_metres_are_kept_and_other_units_undone_exactly(name, shape, exponent, unit, random):
    """A thing of any kind and shape, larger or smaller than usual by up to its spread and with its axes in any order,
    comes out at its true size whatever unit its file is in."""
    thing = things()[name]
    usual = np.array(thing.sizes[shape % len(thing.sizes)])
    size = usual * min(thing.spread, NEAREST) ** exponent
    extents = size[random.sample(range(3), 3)] / UNITS[unit]
    # a small mesh in millimetres or inches can be a plausible one in metres in another shape: nothing tells them apart
    assume(unit == "m" or decided(thing, extents)[0] != 1.0 or len(thing.sizes) == 1)
    assert decided(thing, extents)[0] == UNITS[unit]


@settings(max_examples=400, deadline=None)
@given(st.sampled_from(OBJECTS), st.floats(-2.0, 2.0))
def test_own_units_come_within_the_spread_of_the_usual_size(name, exponent):
    """Whatever the factor, the median over the axes ends within the spread of one of the shapes."""
    thing = things()[name]
    extents = np.array(thing.size) * 10.0**exponent
    scale, _ = decided(thing, extents)
    ratios = np.median(np.array(thing.sizes) / (extents * scale), axis=1)
    assert np.abs(np.log(ratios)).min() <= np.log(thing.spread) + 1e-5


@pytest.mark.parametrize("name", TEXTILES)
def test_textiles_are_kept_folded_and_spread_out(name):
    """Both sizes stay as they are, in metres; a plane without thickness as well."""
    thing = things()[name]
    assert len(thing.sizes) == 2
    for usual in thing.sizes:
        for factor in (1 / thing.spread, 1.0, thing.spread):
            assert decided(thing, np.array(usual) * factor)[0] == 1.0
    flat = max(thing.sizes)
    assert decided(thing, np.array([flat[0], flat[1], 0.0]))[0] == 1.0
    assert decided(thing, np.array([flat[0], flat[1], 0.0]) / 0.01)[0] == 0.01


@pytest.mark.parametrize(
    ("extents", "scale", "words"),
    [
        # of 4.7 x 3.7 x 3.3 inches that the reader of a file without units took as centimetres
        ((0.047, 0.037, 0.033), 2.54, "inches taken as centimetres"),
        ((0.012, 0.0095, 0.0085), 10.0, "usual"),
        ((15.0, 11.9, 10.6), 0.01, "centimetres"),
        ((5.5, 4.4, 3.9), 0.0254, "inches"),
        ((0.35, 0.28, 0.25), 0.12 / 0.35, "usual"),
        ((1.2e-9, 1e-9, 1e-9), 1e3, "clamped"),
    ],
)
def test_a_mug_gets_the_factor_that_the_note_explains(extents, scale, words):
    """Unit or usual size, and why."""
    found, note = decided(things()["mug"], np.array(extents))
    assert found == pytest.approx(scale, rel=0.02)
    assert words in note


@pytest.mark.parametrize("name", ["mug", "apple", "toy_car", "book", "tennis_ball", "pillow"])
def test_embedded_objects_come_out_at_the_size_they_were_made(name):
    """Made in metres, centimetres and inches: exactly; in a unit of their own (a radius, 0.55 m): within 2 %, for they
    are of the usual size."""
    points = np.concatenate([s.vertices for part in build_object(name).parts for s in part.solids])
    unit = object_recipes()[name].unit
    scale, _ = decided(things()[name.replace("_", " ")], np.ptp(points, axis=0))
    assert scale == pytest.approx(unit, rel=0.0 if unit in UNITS.values() else 0.02)


@pytest.mark.parametrize(
    ("source", "extents", "scale", "words"),
    [
        # 34 cm of a file without units read as centimetres: inches would make 86 cm of it, a third too much
        ("estimate", (0.34, 0.24, 0.08), 0.66 / 0.34, "usual"),
        # 26 units read as centimetres: as inches it is 66 cm, the usual size within a tenth
        ("estimate", (0.26, 0.18, 0.05), 2.54, "inches taken as centimetres"),
        # a file that says metres, with a pillow of 95 m: as centimetres too far off the usual 66 to be sure
        ("format", (95.0, 63.0, 19.0), 0.66 / 95.0, "usual"),
        ("format", (62.0, 41.0, 12.0), 0.01, "centimetres"),
        ("estimate", (95.0, 63.0, 19.0), 0.01, "centimetres"),
        ("option", (0.2, 0.14, 0.05), 1.0, "--object-unit"),
        ("option", (95.0, 63.0, 19.0), 1.0, "--object-unit"),
    ],
)
def test_a_guess_weighs_less_than_what_the_file_or_the_user_says(source, extents, scale, words):
    """A pillow: the factor by who said what its unit is, and a note that says what to do about it."""
    pillow = things()["pillow"]
    found = rescale(np.array(pillow.sizes), np.array(extents), pillow.spread, LIMITS, source)
    assert found.scale == pytest.approx(scale, rel=0.12)
    assert words in found.note
    assert "--object-unit" in found.note
