"""No word of a sentence disappears in a scene: it is used, noted, or reported; what changes nothing is not reported."""

import pytest
from furnished_views import ROOM, ask
from hypothesis import given, settings
from hypothesis import strategies as st

from dcap.knowledge.lexicon import split_words
from dcap.language.offline.client import OfflineClient
from dcap.language.offline.placing import placing_of
from dcap.language.offline.reading import Reading
from dcap.language.offline.sentence import read
from dcap.language.offline.target import target_of
from dcap.language.offline.where import Target, facing_of
from dcap.language.offline.words import SceneWords, tokens_of
from dcap.language.protocol.questions import INTENT
from dcap.scene.errors import LanguageError

SCENE = SceneWords.of((one.id, one.label) for one in ROOM)
THINGS = ("the bed", "the left bed", "the red bed", "the desk", "the sofa", "the bookshelf", "the bedside table",
          "the chair", "the floor", "the lamp", "the laptop", "the window", "the wall", "the door", "the pillow",
          "the headboard", "the second shelf from the bottom", "the back of the sofa", "the glorbix", "it",
          "the left edge of the desk", "the edge", "the far end of the desk", "the corner", "the bed with id bed_1",
          "the smaller of the two beds", "the empty chair", "the single bed")  # fmt: skip
RELATIONS = ("on", "on top of", "in", "near", "next to", "in front of", "behind", "under", "against", "nearest",
             "as far as possible from", "away from", "20 cm from", "at least 10 cm from", "5 cm to the left of",
             "with", "that has", "without", "that is near", "that is not near", "but not on", "not near", "opposite",
             "at", "facing", "between", "leaning against")  # fmt: skip
SPOKEN = ("put the ball", "could you please put the ball", "lean the ball", "the ball goes", "I would like the ball",
          "please set the zzyzx")  # fmt: skip
OTHER = ("upside down", "rotated by 30 degrees", "diagonally", "wibbly", "for me, thanks", "?", "very carefully", "red")
PIECES = st.tuples(st.sampled_from(RELATIONS), st.sampled_from(THINGS)).map(" ".join)
SENTENCES = st.tuples(
    st.sampled_from(SPOKEN), st.lists(st.one_of(PIECES, PIECES, st.sampled_from(OTHER)), min_size=1, max_size=4)
).map(lambda pair: " ".join((pair[0], *pair[1])))
SAYS_SOMETHING = (
    "thing",
    "part",
    "region",
    "relation",
    "face",
    "pose",
    "angle",
    "distance",
    "id",
    "unknown",
    "exclude",
)
MAY_BE_DROPPED = ("filler", "det", "conj", "of", "pronoun", "verb", "restrict", "genitive", "quality", "bound")


def told(reading: Reading, target: Target, facing: tuple[str, tuple[str, ...]], name: str) -> str:
    """All that is used, noted or reported of a sentence, in one text."""
    where = [place.text for place in target.used] + target.words + target.notes + target.not_understood
    theme = [reading.theme.text] if reading.theme is not None else []
    front = [reading.facing.text] if reading.facing is not None and facing[0] else []
    said = [reading.pose_words, reading.turn_words, target.missing, name, *facing[1], *reading.aside, *reading.notes]
    return " ".join([*theme, *front, *where, *said])


@settings(max_examples=500, deadline=None, derandomize=True)
@given(prompt=SENTENCES)
def test_every_word_is_used_noted_or_reported_in_a_scene(prompt: str) -> None:
    """Whatever is said of places, distances, exclusions and poses leaves a trace in the answer, or it is refused."""
    try:
        reading = read(prompt, SCENE)
        target = target_of(reading, ask(prompt))
    except LanguageError:
        return
    if target.base is None:
        assert target.missing
        return
    main = placing_of(reading).place.text
    words = set(split_words(told(reading, target, facing_of(reading, target, ask(prompt)), main)))
    for token in tokens_of(prompt, SCENE):
        bare = token.has(*MAY_BE_DROPPED) or token.value("relation") in ("carrying", "lacking")  # its noun is told
        if token.has(*SAYS_SOMETHING) and not bare:
            assert set(split_words(token.text)) <= words, (token.text, words)


POLITE = ("could you please {}?", "I would like you to {}", "{} for me, thanks", "would you mind to {} please",
          "hey, can you {}?", "please {} if you can", "let's {}, thank you very much")  # fmt: skip


@pytest.mark.parametrize("frame", POLITE)
def test_polite_words_are_not_reported(frame: str) -> None:
    """Words that change nothing change nothing: the answer is that of the bare sentence."""
    bare = OfflineClient().ask(INTENT, ask("put the ball on the desk next to the laptop"))
    asked = OfflineClient().ask(INTENT, ask(frame.format("put the ball on the desk next to the laptop")))
    assert asked == bare
    assert asked.not_understood == ()
