"""Shapes that rest on foam at default resolution, against static finite elements of the same contact, or much finer
cells."""

from pathlib import Path

import pytest

from perf.references import REFERENCES, depth_of
from tasks.case.run import run_case

CYLINDER, BALL, COVER = "a flat cylinder", "a ball, E 2e4", "a ball on a bonded cover"


@pytest.mark.long
@pytest.mark.slow
@pytest.mark.parametrize("name", [pytest.param(one, marks=[pytest.mark.long] * (one != BALL)) for one in REFERENCES])
def test_it_sinks_as_deep_as_the_reference(name: str, tmp_path: Path) -> None:
    """The cells follow the shape's own patch, and are finest where it ends at an edge."""
    one = REFERENCES[name]
    result = run_case(one.case, tmp_path, quiet=True, threads=2)
    assert result["verdict"] == "at_rest"
    assert depth_of(result, one) == pytest.approx(one.depth, rel=one.tolerance)


@pytest.mark.long
@pytest.mark.parametrize("name", [BALL, CYLINDER, COVER])
def test_explicit_steps_sink_it_as_deep(name: str, tmp_path: Path) -> None:
    """Within a tenth, as the other method of the same contact."""
    one = REFERENCES[name]
    result = run_case(one.case, tmp_path, solver="mls", quiet=True, threads=2)
    assert result["verdict"] == "at_rest"
    assert depth_of(result, one) == pytest.approx(one.depth, rel=0.1)
