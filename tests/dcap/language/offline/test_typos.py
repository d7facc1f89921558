"""A mistyped word is read as the one known word that it must be, and told; other words stay what they are."""

import pytest

from dcap.language.offline.client import OfflineClient
from dcap.language.offline.words import SceneWords, meant_by, tokens_of, words_of
from dcap.language.protocol.questions import INTENT

KNOWN = frozenset({"table", "chair", "chairs", "sofa", "sofas", "near", "the", "coat", "lamp", "left", "lift"})


@pytest.mark.parametrize(
    ("word", "meant"),
    [
        ("tabel", "table"), ("chiars", "chairs"), ("sofaa", "sofa"), ("neer", "near"), ("teh", "the"), ("lfet", "left"),
        ("goat", ""), ("lamb", ""), ("cat", ""), ("glorbix", ""), ("7up", ""), ("tble", "table"),
    ],
)  # fmt: skip
def test_a_slip_is_mended_and_another_word_is_not(word: str, meant: str) -> None:
    """The first letter stands, short words are mended by a swap or a vowel only, doubtful ones not at all."""
    assert meant_by(word, KNOWN) == meant


def test_words_of_labels_are_known() -> None:
    """What a scene calls its things is no slip, and slips of it are mended to it first."""
    scene = SceneWords.of([("1", "zarbleton"), ("2", "tabla")])
    assert words_of("on the zarbleton", scene).mended == {}
    assert words_of("on the zarblton", scene).mended == {"zarblton": "zarbleton"}


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
