"""The library is complete, physical and hard to get wrong."""

import pytest

from language.lexicon import part_words, things
from language.materials import COLUMNS, load_materials
from scene.errors import InputError


def test_library_covers_indoor_life():
    """At least 80 rows; foams, textiles, woods, metals, glass, ceramics, plastics, rubbers, paper, stone, food."""
    library = load_materials()
    wanted = {
        "foam_mattress", "pillow_polyester", "pillow_down", "towel_stack", "leather", "wood_oak", "steel", "glass",
        "porcelain", "abs", "rubber_soft", "paper_stack", "cardboard", "granite", "apple", "plush_filling",
        "foam_latex",
    }  # fmt: skip
    assert len(library) >= 80
    assert wanted <= library.keys()


def test_stiffness_orders_as_everyone_knows():
    """Down < pillow < mattress < rubber < leather < wood < steel."""
    library = load_materials()
    order = ["pillow_down", "pillow_polyester", "foam_mattress", "rubber_soft", "leather", "wood_pine", "steel"]
    moduli = [library[name].youngs_modulus for name in order]
    assert moduli == sorted(moduli)


def test_class_agrees_with_stiffness():
    """`rigid` is above 1 GPa, `soft` is not."""
    for material in load_materials().values():
        if material.kind != "thin":
            assert (material.youngs_modulus > 1e9) == (material.kind == "rigid"), material.id


def test_lexicon_names_only_rows_of_the_library():
    """Every material that a thing or part names exists."""
    library = load_materials()
    named = {m for thing in things().values() for m in thing.materials.values()}
    named |= {part.material for part in part_words().values()}
    assert named <= library.keys()


GOOD = "a,A,100,1e6,0.3,0.5,0.4,0.001,soft,x,estimate"


@pytest.mark.parametrize(
    ("row", "words"),
    [
        (GOOD.replace("1e6", "-5"), "youngs_modulus_pa"),
        (GOOD.replace("0.3", "0.5", 1), "poisson_ratio"),
        (GOOD.replace("0.4", "0.6"), "dynamic friction"),
        (GOOD.replace("100", "nan"), "density"),
        (GOOD.replace("100", "heavy"), "not a number"),
        (GOOD.replace("soft", "gas"), "class"),
        (GOOD.replace("estimate", ""), "source"),
        (GOOD + "\n" + GOOD, "twice"),
        ("a,b", "fields"),
    ],
)
def test_a_bad_row_is_refused_with_its_line(tmp_path, row, words):
    """File, line, field and value are in the message."""
    file = tmp_path / "materials.csv"
    file.write_text(",".join(COLUMNS) + "\n" + row + "\n")
    with pytest.raises(InputError, match=words) as error:
        load_materials(file)
    assert f"{file}:" in str(error.value)


def test_things_are_plausible():
    """At least 80 things with sizes; densities of their boxes lie between a balloon's and lead's."""
    known = [thing for thing in things().values() if thing.size[0] < 20]
    assert len(known) >= 80
    for thing in known:
        density = thing.mass / (thing.size[0] * thing.size[1] * thing.size[2])
        assert 1.0 < density < 12_000, (thing.id, density)
