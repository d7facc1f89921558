"""A study that is served in the process of the test."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from study_server import ServedStudy, served_study


@pytest.fixture
def study(tmp_path: Path) -> Iterator[ServedStudy]:
    """With two raters who have not answered anything."""
    with served_study(tmp_path) as one:
        yield one
