"""A stage runs once for what decides its result, whatever has happened to its record or its artifact."""

import os
import subprocess
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, cast

import pytest
import small_stages
from patience import wait_until
from small_stages import CHAIN, MakeConfig, chain, computed, ends_of, record_of

from dcap.scene.errors import GeometryError
from dcap.scene.settings import PROJECT_ROOT
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.outcome import Infeasible, Reason
from tasks import run_context
from tasks.artifact import Ref, Store
from tasks.code import Code
from tasks.process import StageProcessError
from tasks.records import FileLocks, find_record, key_of
from tasks.run_context import Event, Mode

Caller = Callable[[Callable[[], Any]], Any]


@pytest.fixture(autouse=True)
def data(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty data folder."""
    monkeypatch.setenv("DCAP_DATA", str(tmp_path / "data"))
    return tmp_path / "data"


@pytest.fixture(params=[Mode.DIRECT, pytest.param(Mode.WATCHED, marks=pytest.mark.slow)])
def called(request: pytest.FixtureRequest) -> Caller:
    """Calls a stage as a placement does that nobody watches, and as Prefect does."""
    if request.param is Mode.DIRECT:
        return lambda call: call()
    request.getfixturevalue("server")
    from prefect import Flow

    def watched(call: Callable[[], Any]) -> Any:
        with run_context.use_context(run_context.RunContext(mode=Mode.WATCHED)):
            return Flow(call, name="watched", persist_result=False)()

    return watched


def a_mesh() -> Ref[Mesh]:
    """A mesh that no stage has made."""
    return Store.default().save(Mesh.of([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]))


def test_a_second_run_computes_nothing() -> None:
    """It returns the same references, and a record says what they were made of."""
    first, ends = ends_of(chain)
    assert (computed(), set(ends.values())) == (CHAIN, {Event.FINISHED})
    second, ends = ends_of(chain)
    assert (computed(), set(ends.values())) == ([], {Event.CACHED})
    assert second == first
    record = second[1].record
    assert record is not None
    assert record.recipe["inputs"]["mesh"] == {"ref": first[0].to_json()}
    assert record.size == Store.default().size(first[1])


def test_what_decides_is_in_the_key(monkeypatch: pytest.MonkeyPatch) -> None:
    """Inputs, settings, code and versions of libraries; not the number of threads, nor how a default was given."""
    make, code = small_stages.make_task, small_stages.make_task.code

    def key(seed: int = 0, **settings: Any) -> str:
        return key_of(make.recipe({"seed": seed, "config": MakeConfig(**settings)}))

    base, keys = key(), [key(seed=1), key(size=2.0), key(size=0.0), key(size=-0.0)]
    assert key(threads=7) == base
    for other in (Code("0" * 64, code.files, code.libraries), Code(code.digest, code.files, {"numpy": "0.1"})):
        monkeypatch.setattr(make, "code", other)
        keys.append(key())
    assert len({base, *keys}) == 7
    mesh = a_mesh()
    refs = [small_stages.double_task(mesh, *given) for given in ((), (2.0,), (3.0,))]
    assert refs[0] == refs[1] != refs[2]
    assert computed() == ["double", "double"]


def test_a_change_runs_what_depends_on_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """Of a setting, of the code; and a stage whose new result is the old one stops the change."""
    chain()
    computed()
    chain(size=3.0)
    assert computed() == CHAIN
    for task, names in ((small_stages.rest_task, ["rest"]), (small_stages.paint_task, ["paint"])):
        code = task.code
        monkeypatch.setattr(task, "code", Code("0" * 64, code.files, code.libraries))
        chain()
        assert computed() == names  # the bytes are those of before
    ends_of(chain, refresh=frozenset({"double"}))
    assert computed() == ["double"]


def test_an_infeasible_passes_through() -> None:
    """A stage that is given one returns that same reference and runs nothing; one that returns one is cached."""
    ref = Store.default().save(Infeasible(Reason.NO_SUPPORT_HIT, "the ray met nothing", None))
    assert small_stages.double_task(cast("Ref[Mesh]", ref)) == ref
    assert computed() == []
    for _ in range(2):
        assert small_stages.refuse_task(a_mesh()).infeasible
    assert computed() == ["refuse"]


DAMAGES: dict[str, Callable[[Path], object]] = {
    "cut short": lambda path: path.write_bytes(path.read_bytes()[:40]),
    "empty": lambda path: path.write_bytes(b""),
    "another tree": lambda path: path.write_text('{"metadata": {}}'),
}


def test_a_damaged_record_is_passed_over(called: Caller) -> None:
    """The stage runs again, under the next name, and is cached there."""

    def every() -> list[Ref[Mesh]]:
        return [small_stages.make_task(10 + number, MakeConfig()) for number in range(len(DAMAGES))]

    first = every()
    paths = [record_of(one) for one in first]
    for path, damage in zip(paths, DAMAGES.values(), strict=True):
        damage(path)
    damaged = [path.read_bytes() for path in paths]
    for path, name in zip(paths, DAMAGES, strict=True):
        assert find_record(path.name)[0] == f"{path.name}-r1", name
    computed()
    assert called(every) == first
    assert computed() == ["make"] * len(DAMAGES)
    assert called(every) == first
    assert computed() == []
    assert [path.read_bytes() for path in paths] == damaged  # nothing is deleted on the way


def test_a_damaged_artifact_is_computed_again() -> None:
    """That stage alone, and the result is the same."""
    first = chain()
    computed()
    for damage in (Path.unlink, lambda path: path.write_bytes(path.read_bytes()[:-1] + b"\1")):
        damage(next(Store.default().folder(first[1]).glob("*.ply")))
        assert ends_of(chain) == (first, dict.fromkeys(CHAIN, Event.CACHED) | {"double": Event.FINISHED})
        assert computed() == ["double"]


def test_threads_that_want_the_same_compute_it_once() -> None:
    """The others wait for the first."""
    refs: list[Ref[Any]] = []
    threads = [threading.Thread(target=lambda: refs.append(small_stages.slow_task(3))) for _ in range(4)]
    for one in threads:
        one.start()
    for one in threads:
        one.join()
    assert len(refs) == 4
    assert len(set(refs)) == 1
    assert computed() == ["slow"]


HELD = """
from small_stages import slow_task
from tasks.records import FileLocks
slow_task(5)
FileLocks().acquire_lock("{key}", "held until this program ends")
print(1, flush=True)
input()
"""


def test_a_record_that_is_being_written_is_waited_for() -> None:
    """Prefect writes in place: what is half there, with its lock held, is no damage."""
    first = small_stages.make_task(0, MakeConfig())
    computed()
    path = record_of(first)
    whole = path.read_bytes()
    path.write_bytes(whole[:40])

    def finish() -> None:
        time.sleep(0.3)
        path.write_bytes(whole)
        locks.release_lock(path.name, "another")

    locks = FileLocks()
    locks.acquire_lock(path.name, "another")
    writer = threading.Thread(target=finish)
    writer.start()
    assert small_stages.make_task(0, MakeConfig()) == first
    writer.join()
    assert computed() == []


@pytest.mark.slow
def test_processes_that_want_the_same_compute_it_once(data: Path) -> None:
    """The second waits for the first; and where one is killed meanwhile, the kernel gives its lock back."""
    path = os.pathsep.join(map(str, (PROJECT_ROOT, PROJECT_ROOT / "tests" / "support")))
    key = key_of(small_stages.slow_task.recipe({"seed": 6}))
    command = [sys.executable, "-c", HELD.format(key=key)]
    with subprocess.Popen(
        command, env=os.environ | {"PYTHONPATH": path}, stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as other:
        wait_until((data / "computed").exists, 60.0, 0.01)
        small_stages.slow_task(5)
        assert computed() == ["slow"]
        assert other.stdout is not None
        assert other.stdout.readline() == b"1\n"
        assert FileLocks().is_locked(key)
        other.kill()
    small_stages.slow_task(6)
    assert computed() == ["slow"]


@pytest.mark.slow
def test_a_stage_has_a_process_of_its_own() -> None:
    """It returns a reference, passes on what our code logs, and raises errors on purpose under their own type."""
    told: list[tuple[float, str]] = []
    with run_context.use_context(run_context.RunContext(on_event=lambda one: told.append((one.part, one.text)))):
        assert small_stages.apart_task(a_mesh()) == a_mesh()
    assert (0.5, "half way") in told
    assert not any("noise" in text for _, text in told)
    with pytest.raises(GeometryError, match="60 vertices > 10"):
        small_stages.fail_task(a_mesh())
    assert computed() == ["apart", "fail"]


@pytest.mark.slow
def test_a_stage_whose_process_dies_runs_once_more(called: Caller) -> None:
    """Memory may have been short; after that it is an error that names the signal and the last words."""
    assert called(lambda: small_stages.die_task(a_mesh(), 1)) == a_mesh()
    assert computed() == ["die", "die"]
    with pytest.raises(StageProcessError, match=r"SIGABRT(.|\n)*last words"):
        called(lambda: small_stages.die_task(a_mesh(), 9))
    assert computed() == ["die", "die"]
