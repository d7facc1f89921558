"""Settings of all tests: random examples are the same in every run; the model's stand-in; one server of Prefect."""

import os
from collections.abc import Iterator
from pathlib import Path

import pytest
from fake_api import KEY, FakeApi
from hypothesis import settings

settings.register_profile("fixed", derandomize=True, deadline=None)
settings.load_profile("fixed")


def prefects() -> dict[str, str]:
    """The variables of Prefect in the environment."""
    return {name: value for name, value in os.environ.items() if name.startswith("PREFECT_")}


@pytest.fixture(autouse=True)
def same_settings_of_prefect() -> Iterator[None]:
    """No test leaves variables of Prefect to the next one, as the address of a server."""
    before = prefects()
    yield
    if prefects() != before:
        for name in prefects():
            del os.environ[name]
        os.environ.update(before)


@pytest.fixture(scope="session")
def shared_server(tmp_path_factory: pytest.TempPathFactory, worker_id: str) -> str:
    """Address of the Prefect server of all tests, those of other processes included. It ends with the last of them."""
    root, before = tmp_path_factory.getbasetemp(), prefects()
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("DCAP_DATA", str((root if worker_id == "master" else root.parent) / "server"))
        for name in before:
            patch.delenv(name)
        from flows.server import prefect_server

        with prefect_server() as url:
            pass
        for name in prefects().keys() - before.keys():
            del os.environ[name]
    return url


@pytest.fixture
def server(shared_server: str, monkeypatch: pytest.MonkeyPatch) -> str:
    """Address of that server, which the environment names."""
    monkeypatch.setenv("PREFECT_API_URL", shared_server)
    return shared_server


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
