"""How likely a noun means an instance: the label's own words weigh, modifiers that contradict it weigh more."""

from dataclasses import replace

import pytest
from furnished_views import part, thing

from dcap.language.offline.ground import named, nameless, near_miss
from dcap.language.offline.likelihood import likelihood
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


@pytest.mark.parametrize(
    ("text", "label", "near"),
    [("coffee table", "side table", "side table"), ("single bed", "bed double", "bed double"), ("piano", "bed", "")],
)
def test_what_nearly_fits_is_asked_about(text: str, label: str, near: str) -> None:
    """A label that is kin, or contradicts one word only, is what "did you mean" names; nothing else is."""
    instances = labelled(label)
    assert near_miss(noun(text, instances), instances) == near


def guessed(name: str, size: tuple[float, float, float], *guesses: tuple[str, float]) -> InstanceView:
    """A thing that only its shape names, the likeliest first."""
    label, confidence = guesses[0]
    return replace(thing(name, label, (0.0, 0.0, 0.5), size), guesses=guesses, confidence=confidence)


LOW = guessed("low", (1.2, 0.7, 0.45), ("bench", 0.52), ("stool", 0.22), ("coffee table", 0.18))
HIGH = guessed("high", (1.6, 0.75, 0.75), ("dining table", 0.7), ("table", 0.2), ("bed", 0.08))
CASE = guessed("case", (0.5, 0.35, 0.3), ("box", 0.6), ("stool", 0.2))


@pytest.mark.parametrize(
    ("text", "meant"),
    [
        ("coffee table", "low"),  # its third guess
        ("bench", "low"),
        ("dining table", "high"),
        ("table", "high"),
        ("desk", "high"),  # kin, which shapes mix up
        ("storage box", "case"),  # shapes know boxes, not what is kept in them
    ],
)
def test_what_a_thing_may_be_by_its_shape_counts(text: str, meant: str) -> None:
    """The noun finds the thing that is most probably called so, whatever its first label is."""
    instances = [LOW, HIGH, CASE]
    said = noun(text, instances)
    best = max(instances, key=lambda one: likelihood(said, one))
    assert best.id == meant
    assert named(said, instances)[0].id == meant


def scanned_room() -> list[InstanceView]:
    """What a scanner that knows few categories calls a bookcase, a low cupboard, a couch and a seat with arms."""
    return [
        thing("tall", "storage", (0, 0, 1), (0.9, 0.35, 2.0), part(0, "board", (0, 0, 1), (0.9, 0.35, 0.02))),
        thing("low", "storage", (2, 0, 0.2), (1.45, 0.42, 0.6), part(0, "top", (2, 0, 0.5), (1.4, 0.42, 0.02))),
        thing("long", "sofa", (0, 2, 0.4), (2.0, 0.9, 0.8), part(0, "seat cushion", (0, 2, 0.4), (1.6, 0.6, 0.1))),
        thing("short", "sofa", (3, 2, 0.5), (0.87, 0.88, 0.95), part(0, "seat cushion", (3, 2, 0.4), (0.6, 0.6, 0.1))),
    ]


@pytest.mark.parametrize(
    ("text", "meant"),
    [
        ("bookshelf", ["tall"]),
        ("shelf", ["tall"]),
        ("sideboard", ["low"]),
        ("armchair", ["short"]),
        ("chair", ["short"]),
        ("sofa", ["long", "short"]),
        ("storage", ["tall", "low"]),
        ("table", []),
    ],
)
def test_wide_categories_of_scanners_are_told_apart_by_size_and_parts(text: str, meant: list[str]) -> None:
    """RoomPlan and headsets know "storage" and "sofa" only."""
    instances = scanned_room()
    assert [one.id for one in named(noun(text, instances), instances)] == meant


def test_the_only_thing_is_what_the_sentence_names_where_nothing_else_does() -> None:
    """A scan of one piece of furniture without a name, of the size of one; what has a name, even an unknown one, or
    company, keeps it."""
    floor = thing("floor", "floor", (0, 0, 0), (4, 4, 0.1), structure=True)
    one, other = (replace(each, size=(2.0, 0.9, 0.8)) for each in labelled("thing", "thing"))
    (small,) = labelled("thing")
    for scene, meant in (
        ([floor, one], [one]),
        ([floor, *labelled("jukebox")], []),
        ([floor, *labelled("storage")], []),
        ([one, other], []),
        ([floor, small], []),
    ):
        assert list(nameless(noun("sofa", scene), scene)) == meant
    assert not nameless(noun("pillow", [one]), [one])


def test_size_counts_where_the_label_names_the_wider_kind() -> None:
    """A scanner's "table" of 94 x 80 cm is no nightstand, one of 50 cm may be."""
    sizes = {"large": (0.94, 0.8, 0.72), "small": (0.5, 0.4, 0.55)}
    tables = [thing(name, "table", (0, 0, 0.3), size) for name, size in sizes.items()]
    assert [one.id for one in named(noun("nightstand", tables), tables)] == ["small"]
