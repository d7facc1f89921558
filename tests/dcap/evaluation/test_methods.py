"""Names of methods: as people type them, as tables show them, and as parts of a sample's id."""

import pytest

from dcap.evaluation.methods import (
    ABLATIONS,
    ALL,
    BASELINES,
    DCAP,
    METHODS,
    OFFLINE,
    baselines_among,
    by_method,
    joined_id,
    methods_of,
    shown_name,
    split_id,
    with_examples,
)
from dcap.scene.errors import InputError
from dcap.scene.types.sample import KnownHeight, Sample, SourceOptions

SAMPLE = Sample("bedroom_01-ball", "bedroom_01", "ball.glb", "put the ball on the bed")


def test_a_method_is_ours_a_baseline_or_an_ablation_and_shown_by_a_name_of_its_own():
    """No two methods share a name; who answered is told of baselines alone; another name is shown as it is."""
    assert list(METHODS) == [DCAP, *BASELINES, *ABLATIONS]
    assert len(set(METHODS.values())) == len(METHODS) == 1 + len(BASELINES) + len(ABLATIONS)
    for name, shown in METHODS.items():
        assert shown_name(name, offline=False) == shown
        assert shown_name(name, offline=True) == shown + (OFFLINE if name in BASELINES else "")
    assert shown_name("of_another_version", offline=True) == "of_another_version"


def test_a_list_of_methods_is_read_in_the_order_of_tables():
    """Whatever the order, blanks and repetitions; `all` is ours, the baselines and the rigid drop."""
    assert methods_of(" no_drop,dcap ,, fireplace,dcap") == ("dcap", "fireplace", "no_drop")
    assert methods_of("all") == ALL == ("dcap", "fireplace", "layoutgpt", "holodeck", "rigid_drop")
    assert methods_of("paper,all") == (*ALL, "paper")
    for text, told in (("dcapp", "did you mean"), ("", "empty"), (" , ", "empty"), ("all,none", "'none' is not one")):
        with pytest.raises(InputError, match=told) as refused:
            methods_of(text)
        assert "\n" not in str(refused.value)


def test_tables_test_against_baselines_and_against_every_method_where_there_are_none():
    assert baselines_among(ALL) == ("fireplace", "layoutgpt", "holodeck")
    assert baselines_among(("dcap", "no_drop")) == ("dcap", "no_drop")


@pytest.mark.parametrize("own", ["a", "house_2/kitchen-mug", "dcap", "", "fire/place"])
def test_an_id_says_method_and_sample(own: str):
    """Of every method; an id with a slash whose beginning is no method is all the sample's own."""
    for method in METHODS:
        assert split_id(joined_id(method, own)) == (method, own)
    sample = Sample(own, "room", "ball.glb", "")
    assert by_method(sample, DCAP) == sample
    assert split_id(by_method(sample, "paper").id) == (by_method(sample, "paper").method, own)


def test_layoutgpt_learns_from_the_whole_data_set_whichever_samples_are_run():
    """Every other scene once, in the file's order; not those that are read otherwise or need more than their file."""
    every = [
        Sample("a", "a.glb", "ball.glb", ""),
        Sample("b", "b.glb", "ball.glb", ""),
        Sample("b2", "b.glb", "mug.glb", ""),
        Sample("c", "c.glb", "ball.glb", ""),
        Sample("inches", "inches.glb", "ball.glb", "", scene_options=SourceOptions(unit="in")),
        Sample("labelled", "labelled.glb", "ball.glb", "", labels="labels.json"),
        Sample("scaled", "scaled.glb", "ball.glb", "", known_height=KnownHeight("table", 0.75)),
    ]
    chosen = [by_method(every[0], DCAP), by_method(every[0], "layoutgpt")]
    ours, theirs = with_examples(chosen, every)
    assert ours == every[0]
    assert theirs.examples == ("b.glb", "c.glb")
    whole = with_examples([by_method(one, "layoutgpt") for one in every], every)
    assert whole[0] == theirs
    assert [one.examples for one in whole[1:3]] == [("a.glb", "c.glb")] * 2
