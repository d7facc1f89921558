"""Lengths and angles as people write them."""

import pytest

from dcap.language.offline.measures import plain_measures
from dcap.language.offline.sentence import read
from dcap.language.offline.words import tokens_of

LENGTHS = {
    "2 1/2 inches": 0.0635,
    "2-1/2 inches": 0.0635,
    "2½ inches": 0.0635,
    "½ inch": 0.0127,
    '1/2"': 0.0127,
    "two and a half inches": 0.0635,
    "three quarters of an inch": 0.01905,
    "a quarter of an inch": 0.00635,
    "an inch": 0.0254,
    "6 in": 0.1524,
    "6in.": 0.1524,
    "1 foot": 0.3048,
    "a foot": 0.3048,
    "a foot and a half": 0.4572,
    "two feet": 0.6096,
    "3 ft.": 0.9144,
    "half a yard": 0.4572,
    "5' 6\"": 1.6764,
    "5 ft 6 in": 1.6764,
    "1 m and 20 cm": 1.2,
    "half a metre": 0.5,
    "1,5 cm": 0.015,
    "0,125 m": 0.125,
    "1,500 mm": 1.5,
    "5-cm": 0.05,
    ".5 m": 0.5,
    "twenty-five centimetres": 0.25,
    "one hundred and twenty mm": 0.12,
    "one foot and three inches": 0.381,
    "two feet, six inches": 0.762,
    "between 10 and 15 cm": 0.125,
    "between 5 mm and 1 cm": 0.0075,
    "10-15 cm": 0.125,
    "ten to fifteen cm": 0.125,
}


def test_a_length_is_read_as_people_write_it() -> None:
    """The distance of a place, in metres."""
    found = {}
    for said in LENGTHS:
        places = read(f"put the mug on the table, {said} from the left edge").places
        found[said] = [place.measure.metres for place in places if place.measure]
    assert found == {said: [pytest.approx(metres, rel=1e-5)] for said, metres in LENGTHS.items()}


@pytest.mark.parametrize(
    "text",
    [
        "put a meter on the table",
        "stand it on its two feet",
        "put 2 in the bowl",
        'put it on "chair 2"',
        "a few inches off",
    ],
)
def test_what_is_no_measure_stays(text: str) -> None:
    """A thing called a meter, feet that one stands on, a number before "in", and an unknown number."""
    assert plain_measures(text) == (text, ())


def test_a_range_is_told() -> None:
    """Its middle is taken, and the reading says so."""
    reading = read("put the mug on the table, 10-15 cm from the left edge")
    assert reading.notes == ("'10-15 cm' is read as its middle, 12.5 cm",)


def test_feet_that_one_stands_on_are_no_length() -> None:
    """Number words before "feet" make a length only before a direction."""
    assert not any(token.has("distance") for token in tokens_of("stand the bear on its two feet"))
