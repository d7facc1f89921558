"""No word of a prompt disappears, whatever the prompt; and what a sentence asks is known before any scene is."""

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from dcap.knowledge.lexicon import vocabulary
from dcap.language.offline.client import OfflineClient
from dcap.language.offline.sentence import read
from dcap.language.offline.words import SceneWords, meant_by, tokens_of
from dcap.language.protocol.questions import INTENT
from dcap.scene.errors import LanguageError

FIXED = HealthCheck.function_scoped_fixture
"""`ask` is the same function for every example."""
NONSENSE = ("glorbix", "wibbly", "zzyzx", "qwop", "brillig", "7up")
KNOWN = sorted({word for phrase in vocabulary() for word in phrase if len(vocabulary().get((word,), ())) == 1})
PLAIN = (
    "put",
    "the",
    "ball",
    "on",
    "bed",
    "left",
    "desk",
    "next to",
    "and",
    ",",
    "of",
    "it",
    "facing",
    "in",
    "red",
    "rotated",
    "30 degrees",
)
PROMPTS = st.lists(
    st.one_of(st.sampled_from(PLAIN), st.sampled_from(KNOWN), st.sampled_from(NONSENSE)), min_size=1, max_size=12
).map(" ".join)


@settings(max_examples=200, deadline=None, derandomize=True, suppress_health_check=[FIXED])
@given(prompt=PROMPTS)
def test_any_prompt_is_answered_or_refused_in_one_line(prompt: str, ask):
    """In a room, every prompt gives a checked reply that reports the unknown words, or a LanguageError."""
    try:
        reply = OfflineClient().ask(INTENT, ask(prompt))
    except LanguageError as caught:
        said = str(caught)
    else:
        said = " ".join((*reply.not_understood, reply.missing))
        assert all(token.text in said.split() for token in tokens_of(prompt) if token.has("unknown"))
    assert "\n" not in said


@pytest.mark.parametrize(
    ("words", "degrees"),
    [
        ("90 degrees", 90), ("-12.5 deg", -12.5), ("7°", 7), ("forty-five degrees", 45), ("400 degrees", 40),
        ("one hundred eighty degrees", 180), ("270 degrees clockwise", -270),
    ],
)  # fmt: skip
def test_angles_are_numbers_in_words_or_digits(words, degrees):
    """A number and its unit are one token; whole turns fall away."""
    reading = read(f"put the mug on the desk rotated by {words}")
    assert (reading.turn, reading.not_understood) == (degrees, ())


@pytest.mark.parametrize(
    ("words", "excluded"),
    [("that has a chair at it", False), ("with a chair next to it", False), ("without a chair at it", True),
     ("that has no chair at it", True), ("that does not have a chair at it", True)],
)  # fmt: skip
def test_what_a_thing_has_beside_it_says_which_is_meant(words: str, excluded: bool) -> None:
    """The desk near a chair, or the one that is not."""
    place = read(f"put the cup on the desk {words}").places[1]
    assert (place.relation, place.restrict, place.excluded) == ("near", True, excluded)


@pytest.mark.parametrize("words", ["nearest the sofa", "facing the sofa", "closest to the sofa", "nearer the sofa"])
def test_an_edge_is_the_one_at_a_thing(words: str) -> None:
    """A distance from it keeps the thing that tells which edge is meant."""
    edge = read(f"put the mug on the table, 10 cm in from the edge {words}").places[1]
    assert edge.measure is not None
    assert edge.measure.metres == pytest.approx(0.1)
    assert edge.nouns[0].toward is not None
    assert edge.nouns[0].toward.thing == "sofa"


@pytest.mark.parametrize("words", ["should stand", "must stand", "has to stand"])
def test_what_a_thing_should_do_is_a_pose(words: str) -> None:
    """As much as if one were told to stand it there."""
    assert read(f"the shampoo bottle {words} on the floor").pose == "upright"


TYPED = frozenset({"table", "chair", "chairs", "sofa", "sofas", "near", "the", "coat", "lamp", "left", "lift"})


@pytest.mark.parametrize(
    ("word", "meant"),
    [
        ("tabel", "table"), ("chiars", "chairs"), ("sofaa", "sofa"), ("neer", "near"), ("teh", "the"), ("lfet", "left"),
        ("goat", ""), ("lamb", ""), ("cat", ""), ("glorbix", ""), ("7up", ""), ("tble", "table"),
    ],
)  # fmt: skip
def test_a_slip_is_mended_and_another_word_is_not(word: str, meant: str) -> None:
    """The first letter stands, short words are mended by a swap or a vowel only, doubtful ones not at all."""
    assert meant_by(word, TYPED) == meant


def test_the_reading_of_a_slip_is_told(ask) -> None:
    """A mended sentence is read as the right one, and a note says what was read."""
    reply = OfflineClient().ask(INTENT, ask("put the balll on teh desk"))
    assert (reply.base_id, reply.not_understood) == ("desk_0", ())
    assert "'teh' is read as 'the'" in reply.notes


@pytest.mark.parametrize(
    ("text", "ids"),
    [
        ("the chair with id chair_2", ["chair_2"]), ("chair_2", ["chair_2"]), ("chair 736", ["736"]), ("736 kg", []),
        ("the table", []), ("the one with id table", ["table"]), ("2 cm from chair 2", ["2"]),
    ],
)  # fmt: skip
def test_ids_of_things_are_words(text: str, ids: list[str]) -> None:
    """An id names its thing; a number alone, or a plain word that is a label as well, does not."""
    scene = SceneWords.of([("chair_2", "chair"), ("736", "chair"), ("table", "table"), ("2", "chair")])
    assert [token.value("id") for token in tokens_of(text, scene) if token.has("id")] == ids
