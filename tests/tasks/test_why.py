"""Why a stage would run is told by what a person can change: an input, a setting, code, a data file, a library."""

from pathlib import Path
from typing import Any

import pytest
from known_records import known_code, known_result, recipe

from tasks.artifact import Ref
from tasks.upkeep import why_not_cached

FILES = {"tasks/drop.py": "a", "solver/step.py": "a", "materials.csv": "a"}


@pytest.fixture(autouse=True)
def data(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A cache of each test's own."""
    monkeypatch.setenv("DCAP_DATA", str(tmp_path))
    return tmp_path


def code_with(**changed: str) -> str:
    """The digest of a list of files, of which some are others than usual."""
    return known_code(FILES | changed)


def drop(inputs: dict[str, Any], **other: Any) -> dict[str, Any]:
    """What a drop is made of."""
    return recipe("drop", inputs, **({"code": code_with()} | other))


def known(inputs: dict[str, Any], **other: Any) -> None:
    """A record of it."""
    known_result("drop", 1.0, inputs, **({"code": code_with()} | other))


def why(tree: dict[str, Any]) -> str:
    """The reason in a line."""
    return why_not_cached(tree, lambda stage, key: f"{stage}.{key}")


SCAN, OTHER = (Ref[Any]("Scan", digit * 64) for digit in "12")


def test_each_part_of_a_key_is_named() -> None:
    """With both values where they are short; what is equal is not told."""
    base = {"scan": SCAN, "seed": 0, "prompt": "on the bed"}
    config = {"solver": {"cell": 0.01, "seed": 0}, "share": 0.5}
    assert why(drop(base)) == "no earlier result"
    known(base, config=config)
    for words, tree in {
        "its result is missing or damaged": drop(base, config=config),
        "input scan differs": drop(base | {"scan": OTHER}, config=config),
        "input seed 0 -> 7": drop(base | {"seed": 7}, config=config),
        "drop.solver.cell 0.01 -> 0.02": drop(base, config=config | {"solver": {"cell": 0.02, "seed": 0}}),
        "code solver/step.py": drop(base, config=config, code=code_with(**{"solver/step.py": "b"})),
        "data file materials.csv": drop(base, config=config, code=code_with(**{"materials.csv": "b"})),
        "code has changed": drop(base, config=config, code="0" * 64),
        "library numpy 2.3.0 -> 2.4.0": drop(base, config=config, libraries={"numpy": "2.4.0"}),
    }.items():
        assert why(tree) == words


def test_the_closest_record_is_that_of_the_same_sample() -> None:
    """One with the same sentence counts before a newer one whose scene is the same; of equals the newest counts, also
    one that came after the first look."""
    known({"scan": SCAN, "prompt": "on the bed"})
    known({"scan": OTHER, "prompt": "on the desk"})
    assert why(drop({"scan": OTHER, "prompt": "on the bed"})) == "input scan differs"
    known({"scan": SCAN, "prompt": "on the bed"}, libraries={"numpy": "2.2.0"})
    assert why(drop({"scan": SCAN, "prompt": "on the bed"}, libraries={"numpy": "2.1.0"})) == (
        "library numpy 2.2.0 -> 2.1.0"
    )
