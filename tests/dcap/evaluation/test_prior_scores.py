"""Scores of priors against published sizes."""

from pathlib import Path

import numpy as np
import pytest

from dcap.evaluation.prior_scores import (
    COLUMNS,
    Published,
    misses,
    prior_score,
    read_published,
    share_within,
    size_ratio,
)
from dcap.language.offline.lexicon import things
from dcap.scene.errors import InputError


def write(path: Path, *rows: str) -> Path:
    path.write_text("\n".join([",".join(COLUMNS), *rows]) + "\n")
    return path


def test_extents_may_be_missing_and_in_any_order(tmp_path):
    """What is stated is compared, largest first; a name is read as a file's label."""
    path = write(tmp_path / "sizes.csv", "Coffee_Mug_02,0.085,0.12,0.095,0.7,x,", "coffee mug,,0.24,,,x,only one")
    three, alone = (prior_score(row) for row in read_published(path))
    mug = things()["mug"]
    assert (three.thing, alone.thing) == ("mug", "mug")
    assert three.size_ratio == pytest.approx(1.0)
    assert three.mass_ratio == pytest.approx(mug.mass / 0.7)
    assert (alone.size_ratio, alone.mass_ratio) == (pytest.approx(mug.size[0] / 0.24), None)


def test_a_disc_is_published_as_diameter_and_height():
    """Of two extents the smaller may be any other axis; of one it is the largest."""
    plate = (0.26, 0.26, 0.025)
    assert size_ratio(plate, (0.26, 0.025)) == pytest.approx(1.0)
    assert size_ratio(plate, (0.13, 0.0125)) == pytest.approx(2.0)
    assert size_ratio(plate, (0.13,)) == pytest.approx(2.0)
    assert size_ratio(plate, (0.52, 0.26, 0.001)) == pytest.approx(1.0)  # the median of 0.5, 1 and 25


def test_the_shape_that_fits_counts():
    """A towel is published folded or spread out."""
    towel = things()["towel"]
    for size in towel.sizes:
        assert prior_score(Published("towel", size, None, "x")).size_ratio == pytest.approx(1.0)


def test_an_unknown_thing_is_a_miss():
    """It counts against the share and is named."""
    score = prior_score(Published("zorb", (1.0,), 2.0, "x"))
    assert (score.thing, score.size_ratio, score.mass_ratio) == ("", np.inf, np.inf)
    assert misses([score]) == ["zorb (unknown): size inf", "zorb (unknown): mass inf"]
    assert share_within([np.inf, 1.0, None, 0.7], 1.5) == pytest.approx(2 / 3)


@pytest.mark.parametrize(
    ("row", "words"),
    [("mug,a,,,1,x,", "could not convert"), ("mug,-1,,,1,x,", "positive"), ("mug,1,,,0,x,", "positive")],
)
def test_a_bad_row_is_refused_with_its_line(tmp_path, row, words):
    """File, line and what is wrong."""
    with pytest.raises(InputError, match=words) as error:
        read_published(write(tmp_path / "sizes.csv", row))
    assert "sizes.csv:2" in str(error.value)


def test_other_columns_are_refused(tmp_path):
    """The message says which are expected."""
    path = tmp_path / "sizes.csv"
    path.write_text("name,size\nmug,1\n")
    with pytest.raises(InputError, match="length_m"):
        read_published(path)
