"""The stages with each client."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from stage_chain import Stages

from dcap.language.protocol.client import ClientName

CLIENTS = (ClientName.OFFLINE, ClientName.ANTHROPIC, pytest.param(ClientName.REPLAY, marks=pytest.mark.slow))
"""A replay asks first, so it costs twice what the model costs; `make check` is content with the other two."""


@pytest.fixture(params=CLIENTS)
def stages(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Stages]:
    """Offline, with the model's stand-in, and with what that was recorded to say; the latter two must have asked it."""
    if request.param is ClientName.OFFLINE:
        yield Stages()
        return
    api = request.getfixturevalue("api")
    yield Stages(request.param, api, tmp_path)
    assert api.asked
