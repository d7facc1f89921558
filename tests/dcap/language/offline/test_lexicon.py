"""The table of things: complete, sourced and without words that mean two things."""

import csv
from collections import Counter
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest

from dcap.knowledge import lexicon
from dcap.knowledge.kinds import deformable_kind, deformable_supports, prior_of
from dcap.knowledge.lexicon import ESTIMATE, THINGS, is_a, rows, thing_of, things
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


def test_a_tool_named_after_food_is_no_food():
    """An unknown word after any food names another thing, whose size and material are not the food's; other words of a
    file's name say nothing."""
    for tool in ("shredder", "mangler", "compactor", "squasher"):
        assert [food for food in (*FOOD, "red apple") if thing_of(f"{food} {tool}") is not None] == []
    for file in ("apple_scan", "011_banana textured", "cheese.lowpoly", "obj apple ycb"):
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


with (Path(__file__).parents[1] / "published_sizes.csv").open(newline="", encoding="utf-8") as table:
    PUBLISHED = list(csv.DictReader(table))
"""Things with what a page states of them: extents in any order [m] and mass [kg], either of which may be missing."""


def size_factor(name: str, extents: list[float]) -> float:
    """Factor between the usual and a published size, the largest extents compared: median over the axes of the shape
    that fits best; of two extents the other may be either of the thing's other axes."""
    if (thing := thing_of(name)) is None:
        return float("inf")
    chosen = [(size[0], *rest) for size in prior_of("", name, thing.size).sizes
              for rest in combinations(size[1:], len(extents) - 1)]  # fmt: skip
    logs = min((np.log(np.divide(one, extents)) for one in chosen), key=lambda one: float(np.abs(one).sum()))
    return float(np.exp(abs(np.median(logs))))


def test_priors_are_right_for_nine_in_ten():
    """Sizes within a factor of 1.5, masses within 2; unknown things count as wrong."""
    sizes, masses = {}, {}
    for row in PUBLISHED:
        name, thing = row["name"], thing_of(row["name"])
        extents = sorted((float(row[key]) for key in ("length_m", "width_m", "height_m") if row[key]), reverse=True)
        if extents:
            sizes[name] = size_factor(name, extents)
        if row["mass_kg"]:
            mass = prior_of("", name, thing.size).mass if thing else float("inf")
            masses[name] = float(np.exp(abs(np.log(mass / float(row["mass_kg"])))))
    for found, least, factor in ((sizes, 90, 1.5), (masses, 50, 2.0)):
        assert len(found) >= least
        wrong = {name: one for name, one in found.items() if one > factor}
        assert len(wrong) <= 0.1 * len(found), wrong


SOFT = {
    "Bed": "bed", "functional bed": "bed", "Multi person sofa": "sofa", "armchair": "soft seat",
    "leather chair": "soft seat", "upholstered stool": "soft seat", "Mattress": "mattress",
    "body pillow": "pillow or cushion", "quilt": "blanket or towel", "teddy bear": "soft toy", "carpet": "rug",
    **dict.fromkeys(("chair", "dining table", "bedside table", "pillow cabinet", "curtain", "wall", "apple", "book",
                     "headboard", "floor lamp", "plant", "", "!!", "teatable", "stool"), ""),
}  # fmt: skip
"""Labels, and which kind of soft support each is: a bedside table is no bed, fruit and curtains carry nothing."""


def test_soft_supports_are_counted():
    """Any case, synonyms, and seats that a word makes soft; one for each label."""
    assert {label: deformable_kind(label) for label in SOFT} == SOFT
    assert deformable_supports(["bed", "Bed", "sofa", "desk"]) == {"bed": 2, "sofa": 1}
