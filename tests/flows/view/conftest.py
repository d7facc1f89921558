"""A viewer without a page."""

from collections.abc import Iterator

import pytest
import viser

from flows.view.serving import open_server


@pytest.fixture
def server() -> Iterator[viser.ViserServer]:
    """A server of the viewer that nobody looks at."""
    one = open_server(18080)
    yield one
    one.stop()
