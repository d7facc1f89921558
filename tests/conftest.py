"""Settings of all tests: random examples are the same in every run; the model's stand-in."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from fake_api import KEY, FakeApi
from hypothesis import settings

settings.register_profile("fixed", derandomize=True, deadline=None)
settings.load_profile("fixed")


@pytest.fixture
def api(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Iterator[FakeApi]:
    """A stand-in for the model; the environment points to it, and no reply of another test is kept."""
    server = FakeApi()
    monkeypatch.setenv("ANTHROPIC_API_KEY", KEY)
    monkeypatch.setenv("ANTHROPIC_BASE_URL", server.url)
    monkeypatch.setattr("dcap.language.model.anthropic_api.USUAL", server.url.partition("//")[2])
    monkeypatch.setenv("NO_PROXY", "127.0.0.1")
    monkeypatch.setenv("DCAP_DATA", str(tmp_path / "data"))  # never the user's own replies
    yield server
    server.close()
