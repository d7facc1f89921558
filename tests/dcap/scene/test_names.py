"""Names are made of words: ids of data sets are none, wherever they stand."""

import uuid

import pytest
from hypothesis import given
from hypothesis import strategies as st

from dcap.scene.text import names_several, not_one_of, readable, says_something, words_of


@given(st.uuids(), st.sampled_from(["{}", "{}_low", "ball {}", "ball_{}"]))
def test_a_uuid_is_no_word(one: uuid.UUID, name: str):
    """With hyphens or without, alone, with a level of detail, or after a word, which stays."""
    for text in (str(one), one.hex if not one.hex.isalpha() else "0" + one.hex, str(one).replace("-", "_")):
        assert words_of(name.format(text)) == (["ball"] if "ball" in name else [])


@pytest.mark.parametrize("name", ["3f2a9c", "B07XJ8C8F5", "dQw4w9WgXcQ", "0042", "000-023", "obj_000012", "v2_final"])
def test_ids_and_counters_say_nothing(name: str):
    """Short hashes, article numbers, numbered folders and files."""
    assert not says_something(name)


@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("025_mug", "mug"), ("BedDouble_A.001", "bed double"), ("wooden_table_02_1k", "wooden table"),
        ("mp3player", "mp3player"), ("iphone13pro", "iphone13pro"), ("24_hex_bolt", "hex bolt"), ("facade", "facade"),
        ("cafe2024", "cafe"), ("tv", "tv"), ("decaf_cafe_bed", "decaf cafe bed"), ("ball_3f2a9c1b", "ball"),
    ],
)  # fmt: skip
def test_words_with_numbers_stay_words(name: str, words: str):
    """Also such as have hexadecimal letters only."""
    assert readable(name) == words


def test_an_id_has_no_readable_name():
    """A number has itself, for want of anything else."""
    assert readable("3f2a9c1b0000aa11") == readable("550e8400-e29b-41d4-a716-446655440000") == ""
    assert readable("0042") == "0042"


def test_words_of_a_closed_list():
    """The nearest one is named if one is near."""
    words = ["offline", "openai"]
    assert not_one_of("opnai", words) == "is not one of offline, openai; did you mean 'openai'?"
    assert not_one_of("nobody", words) == not_one_of(7, words) == "is not one of offline, openai"


@pytest.mark.parametrize(
    ("name", "several"), [("two_sofas", True), ("TableAndChairs", True), ("sofa2", False), ("chest_of_drawers", False)]
)
def test_a_name_may_speak_of_several_things(name: str, several: bool):
    """Counted or joined by "and"; a counter behind a name is none."""
    assert names_several(name) == several
