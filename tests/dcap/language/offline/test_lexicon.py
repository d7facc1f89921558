"""The table of things: complete, sourced and without words that mean two things."""

from collections import Counter
from itertools import islice

import pytest

from dcap.language.offline import lexicon
from dcap.language.offline.lexicon import ESTIMATE, THINGS, is_a, rows, sources_of, thing_of, things
from dcap.scene.errors import InputError

OBJECTS = [one for one in things().values() if not (is_a(one.id, "furniture") or is_a(one.id, "structure"))]


def test_household_objects_are_at_least_two_hundred():
    """Things that one places; furniture and parts of buildings come on top. A page states the size of 200 of them, and
    size or mass of 20 of the furniture."""
    paged = [one for one in things().values() if {one.size_source, one.mass_source} != {ESTIMATE}]
    assert len(OBJECTS) >= 500
    assert sum(one.size_source != ESTIMATE for one in OBJECTS) >= 200
    assert sum(one not in OBJECTS for one in paged) >= 20


def test_no_word_names_two_things():
    """Synonyms and ids are unique, so a label means one thing; every one finds its thing."""
    names = [(name, row["id"]) for row in rows(THINGS) for name in (row["id"], *row["synonyms"].split("|")) if name]
    assert [name for name, count in Counter(name for name, _ in names).items() if count > 1] == []
    lost = [
        (name, found.id if found else "") for name, own in names if (found := thing_of(name)) is None or found.id != own
    ]
    assert lost == []


KINDS = {
    "toaster": "toaster", "coffee machine": "coffee maker", "letter": "letter", "newspaper": "newspaper",
    "pliers": "pliers", "screwdriver": "screwdriver", "paint brush": "paintbrush", "toothbrush": "toothbrush",
    "soap dispenser": "soap dispenser", "bar of soap": "soap", "waste bin": "trash can", "pail": "bucket",
    "ketchup": "ketchup", "jam jar": "jar", "kitchen worktop": "counter", "wine glass": "wine glass",
    "sunglasses": "glasses", "cheese grater": "grater", "egg cup": "egg cup", "washstand": "bathroom cabinet",
    "Knives": "knife", "BookShelves_01": "shelf", "mice": "mouse",
}  # fmt: skip
"""Labels, and the thing that each of them means."""


def test_kinds_that_differ_in_size_are_rows_of_their_own(subtests: pytest.Subtests):
    """Synonyms, plurals and file names lead to the kind whose size is meant."""
    for label, name in KINDS.items():
        with subtests.test(label):
            found = thing_of(label)
            assert found is not None
            assert found.id == name


FOOD = [one.id for one in things().values() if is_a(one.id, "food")]


@pytest.mark.parametrize("tool", ["shredder", "mangler", "compactor", "squasher"])
def test_a_tool_named_after_food_is_no_food(tool):
    """An unknown word after any food names another thing, whose size and material are not the food's."""
    taken = {food: found.id for food in FOOD if (found := thing_of(f"{food} {tool}")) is not None}
    assert taken == {}
    assert thing_of(f"red apple {tool}") is None


@pytest.mark.parametrize("file", ["apple_scan", "011_banana textured", "cheese.lowpoly", "obj apple ycb"])
def test_other_words_of_a_file_do_not_hide_food(file):
    """What stands in file names beside the thing says nothing of it."""
    found = thing_of(file)
    assert found is not None
    assert is_a(found.id, "food")


LABELS = """
chair|armchair|high chair|stool|massage chair|sofa|multi person sofa|sofa combination
bed|functional bed|bed combination
dining table|table|teatable|conference table|side table|desk|toilet|basin|hand sink combination|basin cabinet|tv
refrigerator|freezer|shelf|cabinet|wardrobe|storage cabinet|display cabinet|tv cabinet|bedside table|trash can
floor lamp|table lamp|plant|flowerpot|potted plant|wall|floor|ceiling|room|door|window|carpet|rug|chandelier|downlights
spotlight|strip light|curtain|book|fruit|toiletries|quilt|pillow|body pillow|blanket|cushion|towel
"""


def test_labels_of_annotated_rooms_are_known(subtests: pytest.Subtests):
    """Every label that says something is a thing, in any case of letters; a mattress is known as a part."""
    for label in LABELS.replace("\n", "|").strip("|").split("|"):
        with subtests.test(label):
            found = thing_of(label.title())
            assert found is not None
            assert found == thing_of(label)


def test_kinds_of_kinds_end():
    """No thing is, over its parents, a kind of itself, and there are at most a few levels."""
    for one in things().values():
        assert len(list(islice(lexicon.lineage(one.id), 10))) <= 4


@pytest.mark.parametrize(
    "text", ["", "guess", "http:/x", "size: estimate", "size: a; mass: estimate", "a page; another"]
)
def test_a_source_is_an_address_or_the_word_estimate(text):
    """Anything else is refused."""
    with pytest.raises(ValueError, match="estimate"):
        sources_of(text)


def test_a_source_may_say_size_and_mass_apart():
    """One address for both, or each its own."""
    page = "https://example.org/mug"
    assert sources_of(page) == (page, page)
    assert sources_of(f"size: {page}; mass: estimate") == (page, ESTIMATE)


GOOD = "mug2,cup,,,0.1x0.1x0.1,1.5,0.3,1,upright,body=stoneware,estimate"


@pytest.mark.parametrize(
    ("row", "words"),
    [
        (GOOD.replace("0.1x0.1x0.1", "0.1x0.1"), "three positive metres"),
        (GOOD.replace("0.1x0.1x0.1", "0.1x0.1x0.1|0.1x0x0.1"), "three positive metres"),
        (GOOD.replace("1.5", "0.5"), "spread"),
        (GOOD.replace("0.3", "-1"), "mass"),
        (GOOD.replace("estimate", "someone said"), "source"),
        (GOOD + "\n" + GOOD, "twice"),
    ],
)
def test_a_bad_row_is_refused_by_name(tmp_path, monkeypatch, row, words):
    """The file and the thing are in the message."""
    (tmp_path / "lexicon").mkdir()
    header = "id,parent,synonyms,plural,size_m,spread,mass_kg,hollow,rest,materials,source"
    (tmp_path / THINGS).write_text(f"{header}\n{row}\n")
    monkeypatch.setattr(lexicon, "FOLDER", tmp_path)
    with pytest.raises(InputError, match=words) as error:
        things.__wrapped__()
    assert "mug2" in str(error.value)
