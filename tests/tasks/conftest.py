"""The stages with each client, and an empty store."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from stage_chain import MARKS, Stages

from dcap.language.protocol.client import ClientName
from tasks.artifact import Store


@pytest.fixture(params=[pytest.param(one, marks=MARKS.get(one, ())) for one in ClientName])
def stages(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Stages]:
    """Offline, with the model's stand-in, and with what that was recorded to say; the latter two must have asked it."""
    if request.param is ClientName.OFFLINE:
        yield Stages()
        return
    api = request.getfixturevalue("api")
    yield Stages(request.param, api, tmp_path)
    assert api.asked


@pytest.fixture
def store(tmp_path: Path) -> Store:
    """An empty store."""
    return Store(tmp_path / "store")
