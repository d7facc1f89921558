"""A room as the clients see it, and questions about it."""

import pytest
from furnished_views import ROOM, ask

from dcap.language.protocol.requests import InstanceView


@pytest.fixture
def room() -> tuple[InstanceView, ...]:
    """The room's instances."""
    return ROOM


@pytest.fixture(name="ask")
def ask_fixture():
    """Makes the intent question for a prompt."""
    return ask
