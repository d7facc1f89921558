"""The library is complete, physical and hard to get wrong."""

import math

import pytest

from dcap.knowledge.lexicon import part_words, things
from dcap.knowledge.material_table import COLUMNS, SOURCED, load_materials, sources_of
from dcap.scene.errors import InputError


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


MEASURED = [
    ("wood_oak", "wood_oak", 0.5, 0.5), ("brick", "wood_oak", 0.6, 0.6), ("wood_oak", "steel", 0.2, 0.6),
    ("wood_oak", "concrete", 0.62, 0.62), ("cast_iron", "wood_oak", 0.49, 0.49), ("brass", "steel", 0.51, 0.51),
    ("copper", "steel", 0.53, 0.53), ("aluminium", "steel", 0.61, 0.61), ("glass", "steel", 0.5, 0.7),
    ("leather", "steel", 0.4, 0.56), ("rubber_soft", "concrete", 1.0, 1.0), ("apple", "apple", 0.42, 0.42),
    ("ptfe", "ptfe", 0.04, 0.04),
]  # fmt: skip
"""Measured friction of clean, dry pairs, as published tables of pairs give it: lowest and highest."""


def test_the_geometric_mean_comes_near_measured_pairs():
    """Within a factor of 1.4 of what was measured: tables differ from each other by as much."""
    library, missed = load_materials(), []
    for one, other, low, high in MEASURED:
        friction = math.sqrt(library[one].static_friction * library[other].static_friction)
        if not low / 1.4 <= friction <= 1.4 * high:
            missed.append((one, other, friction))
    assert missed == []


def test_things_are_plausible():
    """At least 80 things with sizes; densities of their boxes lie between a balloon's and lead's."""
    known = [thing for thing in things().values() if thing.size[0] < 20]
    assert len(known) >= 80
    for thing in known:
        density = thing.mass / (thing.size[0] * thing.size[1] * thing.size[2])
        assert 1.0 < density < 12_000, (thing.id, density)


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
