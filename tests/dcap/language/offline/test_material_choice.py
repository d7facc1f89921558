"""Which row a part gets offline: words of prompt and label, the thing's own list, category, part name, fallback."""

import pytest

from dcap.knowledge.lexicon import FAMILY_WORDS as GENERIC
from dcap.knowledge.lexicon import part_words, rows, things
from dcap.knowledge.material_table import FAMILIES, families, load_materials
from dcap.knowledge.usual_materials import MADE_OF, USUAL, materials_in, named_phrases
from dcap.language.offline.client import OfflineClient
from dcap.language.offline.material_choice import OBJECT, chosen_materials
from dcap.language.protocol.questions import INTENT
from dcap.language.protocol.requests import MaterialQuestion, MaterialsRequest, PartView

LIBRARY = tuple(load_materials().values())
BASE = "base"


def chosen(body: str, label: str, part: str, prompt: str = "") -> tuple[str, str]:
    """Row and reason for one part."""
    question = MaterialQuestion(body, label, PartView(0, part, (0.0, 0.0, 0.0), (0.1, 0.1, 0.1)))
    choice = next(chosen_materials(MaterialsRequest(prompt, (question,), LIBRARY, BASE)))
    return choice.material, choice.reason


SUPPORTS = [
    # adjectives of the label decide the parts that they speak of
    ("leather sofa", "seat cushion", "", "leather_upholstery"),
    ("leather sofa", "base", "", "wood_pine"),
    ("Multi person sofa", "seat cushion", "", "foam_seat"),
    ("wooden chair", "seat", "", "wood_beech"),
    ("metal chair", "seat", "", "steel"),
    ("glass table", "top", "", "glass"),
    ("glass table", "leg", "", "wood_oak"),
    ("metal bed", "frame", "", "steel"),
    ("metal bed", "mattress", "", "foam_mattress"),
    ("memory foam mattress", "body", "", "foam_memory"),
    ("glass lamp", "shade", "", "glass"),
    ("glass lamp", "pole", "", "steel"),
    ("wooden floor", "floor", "", "laminate"),
    # no adjective: category, then part name
    ("bed", "pillow", "", "pillow_polyester"),
    ("bed", "body", "", "foam_mattress"),
    ("bathtub", "rim", "", "acrylic"),
    ("window", "body", "", "glass"),
    ("bookshelf", "board", "", "wood_oak"),
    ("orange sofa", "seat cushion", "", "foam_seat"),
    # the prompt's words about the base count, those about others do not
    ("sofa", "seat cushion", "put the mug on the leather sofa", "leather_upholstery"),
    ("table", "top", "place the wooden bowl on the glass table", "glass"),
    ("table", "leg", "place the wooden bowl on the glass table", "wood_oak"),
    ("table", "top", "put it on the table next to the glass vase", "wood_oak"),
    ("table", "top", "put the ball on the glass top of the table", "glass"),
    ("bed", "mattress", "put it on the memory foam mattress of the bed", "foam_memory"),
]
THINGS = [
    ("mug", "body", "", "stoneware"),
    ("steel mug", "body", "", "steel"),
    ("mug", "body", "put the steel mug on the wooden chair", "steel"),
    ("mug", "body", "put the mug on the steel table", "stoneware"),
    ("mug", "body", "put the mug made of glass on the desk", "glass"),
    ("glass bottle", "body", "", "glass"),
    ("rubber duck", "body", "", "pvc_soft"),
    ("silver laptop", "body", "", "aluminium"),
    ("wooden spoon", "body", "", "wood_beech"),
    ("leather shoe", "sole", "", "rubber_sole"),
    ("latex pillow", "body", "", "pillow_latex"),
    ("mug", "body", "put the mug upside down on the table", "stoneware"),
    ("bread knife", "body", "", "steel"),
]


def test_the_material_of_a_part_of_the_support(subtests: pytest.Subtests) -> None:
    """Words decide the parts that they can mean; all others are what is usual."""
    for label, part, prompt, material in SUPPORTS:
        with subtests.test(str((label, part, prompt))):
            assert chosen(BASE, label, part, prompt)[0] == material


def test_the_material_of_the_object(subtests: pytest.Subtests) -> None:
    """The same for the object, of which the prompt speaks first."""
    for label, part, prompt, material in THINGS:
        with subtests.test(str((label, part, prompt))):
            assert chosen(OBJECT, label, part, prompt)[0] == material


def test_what_is_neither_object_nor_base_hears_nothing_of_the_prompt() -> None:
    """Another table in reach need not be the glass table that was asked for."""
    assert chosen("neighbour", "table", "top", "put the mug on the glass table")[0] == "wood_oak"


def test_the_reason_says_whose_word_it_was() -> None:
    """A reader of the report sees the phrase and where it stands."""
    assert chosen(BASE, "leather sofa", "back")[1].startswith("the label says 'leather'")
    assert chosen(BASE, "sofa", "back", "put it on the leather sofa")[1].startswith("the prompt says 'leather'")
    assert chosen(BASE, "bathtub", "rim")[1] == "usual for the rim of a bathtub"


@pytest.mark.parametrize(
    ("label", "part", "material", "reason"),
    [
        ("zorb", "body", "wood_oak", "fallback: nothing is known about 'body' of 'zorb'"),
        (
            "mattress gizmo",
            "x",
            "foam_seat",
            "fallback for soft things: nothing is known about 'x' of 'mattress gizmo'",
        ),
    ],
)
def test_unknown_things_get_a_fallback_that_says_so(label: str, part: str, material: str, reason: str) -> None:
    """Soft if a word says soft, else rigid."""
    assert chosen(OBJECT, label, part) == (material, reason)


def test_words_for_materials_count_as_understood(ask) -> None:
    """Those of object and support; the same word elsewhere stays unknown."""
    client = OfflineClient()
    assert client.ask(INTENT, ask("put the steel mug on the velvet sofa", "mug")).not_understood == ()
    assert "velvet" in client.ask(INTENT, ask("put the mug on the sofa with velvet", "mug")).not_understood


def test_a_colour_is_no_material() -> None:
    """Silver and orange things are painted; a thing that *is* an orange is one."""
    assert [n.material for n in materials_in(["silver", "orange", "lamp"], head=True)] == []
    assert [n.material for n in materials_in(["orange"], head=True)] == ["citrus"]


def test_a_material_outside_the_library_is_never_chosen() -> None:
    """The request's rows are all there is."""
    question = MaterialQuestion(OBJECT, "steel mug", PartView(0, "body", (0.0, 0.0, 0.0), (0.1, 0.1, 0.1)))
    few = tuple(row for row in LIBRARY if row.id in ("stoneware", "wood_oak"))
    choice = next(chosen_materials(MaterialsRequest("", (question,), few)))
    assert choice.material == "stoneware"


def test_the_data_name_only_what_there_is() -> None:
    """Things, parts, families and rows of the three tables exist, and no word names two materials."""
    library = load_materials()
    parts = {*part_words(), "body", "door", "floor", "surface", "*"}
    for row in rows(MADE_OF):
        assert row["family"] in FAMILIES, row
        assert {one for one in row["owners"].split("|") if one} <= {*things()} | {
            thing.parent for thing in things().values()
        }, row
        assert {one for one in row["parts"].split("|") if one} <= parts, row
        assert not row["material"] or row["material"] in library, row
    for row in rows(USUAL):
        assert not row["thing"] or row["thing"] in things(), row
        assert row["material"] in library, row
        assert not row["thing"] or {*row["parts"].split("|")} <= parts, row
    for row in rows(GENERIC):
        assert families()[row["material"]] in (row["family"], "upholstery"), row
    assert len(named_phrases()) > 200
