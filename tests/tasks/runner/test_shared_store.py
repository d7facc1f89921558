"""Stages that one machine has run are cached on another that shares its store."""

import importlib
from collections.abc import Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import pytest

from dcap.scene.errors import StoreError
from dcap.scene.store.artifacts import Store
from dcap.scene.store.ref import Ref
from tasks.runner.context import Event, RunContext, StageEvent, use_context
from tasks.runner.records import records_root

STAGES = """
import numpy as np
from dcap.scene.types.mesh import Mesh
from tasks.runner.stage import stage

def shared_make(seed: int) -> Mesh:
    return Mesh.of(np.random.default_rng(seed).random((30, 3)), [[0, 1, 2]])

def shared_double(mesh: Mesh) -> Mesh:
    return mesh.transformed(np.diag([2.0, 2.0, 2.0, 1.0]))

make_task = stage(shared_make)
double_task = stage(shared_double, process=True)
"""


@pytest.fixture(scope="module")
def fake(tmp_path_factory: pytest.TempPathFactory) -> Iterator[ModuleType]:
    """The fake stages, on the path of child processes as well."""
    folder = tmp_path_factory.mktemp("stages")
    (folder / "fake_shared_stages.py").write_text(STAGES)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("PYTHONPATH", str(folder))
        patch.syspath_prepend(str(folder))
        yield importlib.import_module("fake_shared_stages")


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """A Prefect server for this module."""
    from flows.server import prefect_server

    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("DCAP_DATA", str(tmp_path_factory.mktemp("server")))
        patch.delenv("PREFECT_API_URL", raising=False)
        with prefect_server() as url:
            yield url


def run(fake: ModuleType, **settings: object) -> tuple[Ref[Any], dict[str, Event]]:
    """Both stages as a flow; what was returned and how each ended."""
    from prefect import Flow

    ends: dict[str, Event] = {}

    def note(event: StageEvent) -> None:
        if event.event in (Event.FINISHED, Event.CACHED):
            ends[event.stage] = event.event

    def chain() -> Ref[Any]:
        return fake.double_task(fake.make_task(3))

    with use_context(RunContext(on_event=note, **settings)):  # type: ignore[arg-type]
        return (chain() if settings else Flow(chain, name="chain")()), ends


COMPUTED = {"shared_make": Event.FINISHED, "shared_double": Event.FINISHED}
CACHED = {"shared_make": Event.CACHED, "shared_double": Event.CACHED}


@pytest.mark.slow
@pytest.mark.long
def test_a_stage_runs_once_for_all_machines(
    server: str, fake: ModuleType, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Computed by the first, cached for the second in a plan and for the third in a flow; after the shared store was
    damaged computed once more, with the same result for everybody."""
    shared = tmp_path / "shared"
    monkeypatch.setenv("DCAP_STORE", str(shared))
    monkeypatch.setenv("DCAP_DATA", str(tmp_path / "one"))
    first, ends = run(fake)
    assert ends == COMPUTED
    monkeypatch.setenv("DCAP_DATA", str(tmp_path / "two"))
    assert run(fake, lookup_only=True) == (first, CACHED)
    monkeypatch.setenv("DCAP_DATA", str(tmp_path / "three"))
    assert run(fake) == (first, CACHED)
    assert Store.default().is_here(first)
    assert len(list(records_root().iterdir())) == 2

    for path in shared.rglob("*.tar"):
        path.write_bytes(path.read_bytes()[:700])
    monkeypatch.setenv("DCAP_DATA", str(tmp_path / "four"))
    assert run(fake) == (first, COMPUTED)
    monkeypatch.setenv("DCAP_DATA", str(tmp_path / "five"))
    assert run(fake) == (first, CACHED)
    monkeypatch.delenv("DCAP_STORE")
    assert run(fake) == (first, CACHED)  # everything is here


def test_a_store_that_cannot_be_opened_ends_the_command(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Once, with exit code 2, before anything runs; commands that compute nothing do not look."""
    from flows.cli.app import main

    monkeypatch.setenv("DCAP_DATA", str(tmp_path / "data"))
    monkeypatch.setenv("DCAP_STORE", "nonsense://user:password@host/x")
    for words in (["benchmark"], ["plan"], ["place", "a.obj", "b.obj", "put it down"]):
        assert main(words) == 2
        said = capsys.readouterr().err
        assert said.startswith("dcap: DCAP_STORE=nonsense://***@host/x: cannot be opened: ")
        assert len(said.splitlines()) == 1
        assert "password" not in said
    assert not (tmp_path / "data" / "runs").exists()
    with pytest.raises(StoreError, match="DCAP_STORE"):
        Store.default()
