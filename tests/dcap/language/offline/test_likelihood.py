"""How likely a noun means an instance: the label's own words weigh, modifiers that contradict it weigh more."""

import pytest
from furnished_views import thing

from dcap.language.offline.ground import named, near_miss
from dcap.language.offline.likelihood import LEAST, PLAUSIBLE, likelihood
from dcap.language.offline.sentence import read
from dcap.language.offline.words import SceneWords
from dcap.language.protocol.requests import InstanceView


def labelled(*labels: str) -> list[InstanceView]:
    return [thing(f"i{k}", label, (k, 0.0, 0.5), (0.5, 0.5, 0.5)) for k, label in enumerate(labels)]


def noun(text: str, instances: list[InstanceView]):
    scene = SceneWords.of((one.id, one.label) for one in instances)
    return read(f"put it on the {text}", scene).places[0].nouns[0]


@pytest.mark.parametrize(
    ("text", "labels", "meant"),
    [
        ("single bed", ("bed double clone", "bed single clone"), ["bed single clone"]),
        ("double bed", ("bed double clone", "bed single clone"), ["bed double clone"]),
        ("bed", ("bed double clone", "bed single clone"), ["bed double clone", "bed single clone"]),
        ("table", ("dining table", "coffee table", "desk"), ["dining table", "coffee table"]),
        ("table", ("desk",), ["desk"]),
        ("chair", ("armchair", "chair"), ["chair"]),
        ("chair", ("armchair",), ["armchair"]),
        ("couch", ("multi person sofa", "armchair"), ["multi person sofa"]),
        ("ottoman", ("stool", "chair"), ["stool"]),
        ("coffee table", ("side table",), []),
        ("single bed", ("bed double",), []),
        ("glorbix", ("red glorbix", "bed"), ["red glorbix"]),
        ("piano", ("cabinet", "bed"), []),
        ("wooden table", ("table", "glass table"), ["table"]),
    ],
)
def test_a_noun_means_what_is_called_so(text: str, labels: tuple[str, ...], meant: list[str]) -> None:
    """The likeliest, and what is at least half as likely, in the order of the scene."""
    instances = labelled(*labels)
    assert [one.label for one in named(noun(text, instances), instances)] == meant


def test_likelihoods_are_ordered_as_the_words_are() -> None:
    """The same words before a kind that is called so, before a kind by another name, before the wider kind, before kin;
    all of them between 0 and 1."""
    table, ottoman, coffee = (labelled(text)[0].label for text in ("table", "ottoman", "coffee table"))
    pairs = [(table, "table"), (table, "dining table"), (table, "desk"), (ottoman, "stool"), (coffee, "side table")]
    scores = [likelihood(noun(text, []), labelled(label)[0]) for text, label in pairs]
    assert scores == sorted(scores, reverse=True)
    assert len(set(scores)) == len(scores)
    assert 0.0 < scores[-1] < LEAST < scores[-2] < scores[0] == 1.0
    assert scores[2] < PLAUSIBLE * scores[0] < scores[1]


def test_an_id_means_its_instance_alone() -> None:
    """The chair with id i1 is that one, whatever it is called."""
    instances = labelled("chair", "stool", "chair")
    said = noun("chair with id i1", instances)
    assert [likelihood(said, one) for one in instances] == [0.0, 1.0, 0.0]


@pytest.mark.parametrize(
    ("text", "label", "near"),
    [("coffee table", "side table", "side table"), ("single bed", "bed double", "bed double"), ("piano", "bed", "")],
)
def test_what_nearly_fits_is_asked_about(text: str, label: str, near: str) -> None:
    """A label that is kin, or contradicts one word only, is what "did you mean" names; nothing else is."""
    instances = labelled(label)
    assert near_miss(noun(text, instances), instances) == near
