"""The library is complete, physical and hard to get wrong."""

import pytest

from dcap.knowledge.lexicon import part_words, things
from dcap.knowledge.material_table import COLUMNS, SOURCED, load_materials, sources_of
from dcap.scene.errors import InputError


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


GOOD = "a,A,100,1e6,0.3,,,,0.5,0.4,0.001,foam,soft,x,estimate"
LAYERS = GOOD.replace("0.3,,,,", "0.05,1e7,0.2,1e4,")
PAGE = '"density, poisson_ratio: https://a.page/b | rest: estimate"'


BAD_ROWS = [
    (GOOD.replace("1e6", "-5"), "youngs_modulus_pa"),
    (GOOD.replace("0.3", "0.5", 1), "poisson_ratio"),
    (GOOD.replace("0.4", "0.6"), "dynamic friction"),
    (GOOD.replace("100", "nan"), "density"),
    (GOOD.replace("100", "heavy"), "not a number"),
    (GOOD.replace("soft", "gas"), "class"),
    (GOOD.replace("foam", "air"), "family"),
    (GOOD.replace("estimate", ""), "source"),
    (GOOD.replace("estimate", "a book"), "source"),
    (GOOD.replace("estimate", PAGE.replace(" | rest: estimate", "")), "no source of youngs_modulus"),
    (GOOD.replace("estimate", PAGE.replace("density", "mass")), "source of 'mass'"),
    (GOOD.replace("estimate", PAGE.replace("poisson_ratio", "density")), "source of 'density'"),
    (GOOD.replace("estimate", PAGE.replace("https://a.page/b", "a.page")), "'COLUMNS: URL"),
    (GOOD + "\n" + GOOD.replace("a,A", "b,B"), "'x' names a already"),
    (GOOD + "\n" + GOOD, "twice"),
    (LAYERS.replace("0.05", "0.3"), r"Poisson ratio across the layers is 0\.3, must be below 0\.2"),
    (LAYERS.replace("1e4", "0"), "layer_shear_modulus_pa 0 is outside"),
    (LAYERS.replace("1e4", ""), "layer_shear_modulus_pa '' is not a number"),
    (LAYERS.replace("estimate", PAGE.replace("rest", "youngs_modulus, static_friction")), "no source of"),
    ("a,b", "fields"),
]
"""Rows, and what is said of each: a regular expression."""


def test_a_bad_row_is_refused_with_its_line(tmp_path, subtests: pytest.Subtests):
    """File, line, field and value are in the message."""
    file = tmp_path / "materials.csv"
    for row, words in BAD_ROWS:
        with subtests.test(str(row)):
            file.write_text(",".join(COLUMNS) + "\n" + row + "\n")
            with pytest.raises(InputError, match=words) as error:
                load_materials(file)
            assert f"{file}:" in str(error.value)


def test_a_source_says_which_columns_it_holds_for():
    """Named columns have the page, with how the number follows from it; the rest is an estimate."""
    found = sources_of(
        "density: https://a.page | youngs_modulus: https://b.page (EPS22: 50 kPa at 1 %) | rest: estimate", ""
    )
    assert found["density"] == "https://a.page"
    assert found["youngs_modulus"] == "https://b.page (EPS22: 50 kPa at 1 %)"
    assert {found[name] for name in SOURCED[2:]} == {"estimate"}
    assert set(sources_of("estimate", "").values()) == {"estimate"}


def test_what_lies_in_layers_slips_more_easily_than_an_isotropic_block():
    """Cloth and fibre fillings: stiffer along their layers than across, and their shear modulus below half of mu."""
    library = load_materials()
    layered = [(row, row.layers) for row in library.values() if row.layers is not None]
    names = {row.id for row, _ in layered}
    assert {"towel_stack", "blanket_stack", "pillow_polyester", "plush_filling", "cotton_stack"} <= names
    assert {"foam_mattress", "felt", "steel", "leather"}.isdisjoint(names)
    for row, layers in layered:
        assert layers.youngs_modulus > row.youngs_modulus
        assert layers.shear_modulus < 0.5 * row.youngs_modulus / (2.0 * (1.0 + row.poisson_ratio))
