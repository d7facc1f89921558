"""Stages run once per set of deciders, notice damage, and hand an Infeasible through."""

import json
import os
import subprocess
import sys
import textwrap
from collections.abc import Callable, Iterator
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pytest
from process_jobs import alive, wait_until

from dcap.language.protocol.session import Session
from dcap.scene.errors import GeometryError, StoreError
from dcap.scene.store.artifacts import Store
from dcap.scene.store.ref import Ref
from dcap.scene.types.materials import Material
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.outcome import Infeasible, Reason
from dcap.scene.types.sample import SourceOptions
from tasks.runner.context import Event, NotCachedError, RunContext, StageEvent, use_context
from tasks.runner.locks import FileLocks
from tasks.runner.process import StageProcessError, run_in_process
from tasks.runner.records import read_record, records_root, usable_key
from tasks.runner.why import in_words, why_not_cached

STAGES = """
import logging, os, sys
import numpy as np
from pydantic import BaseModel
from dcap.scene.errors import GeometryError
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.sample import SourceOptions
from tasks.runner.stage import stage

class MakeConfig(BaseModel, frozen=True, extra="forbid"):
    size: float = 1.0
    threads: int = 0

def make(seed: int, options: SourceOptions, config: MakeConfig) -> Mesh:
    return Mesh.of(np.random.default_rng(seed).random((30, 3)) * config.size, [[0, 1, 2]])

def double(mesh: Mesh) -> Mesh:
    print("noise on standard output")
    logging.getLogger("dcap.geometry.double").info("half way", extra={"progress": 0.5})
    return mesh.transformed(np.diag([2.0, 2.0, 2.0, 1.0]))

def grow(mesh: Mesh, config: MakeConfig, factor: float | None = None) -> Mesh:
    return mesh

def fail(mesh: Mesh) -> Mesh:
    raise GeometryError("mesh has 30 vertices > 10; lower the knob")

def die(mesh: Mesh) -> Mesh:
    print("last words", file=sys.stderr)
    os.abort()

make_task = stage(make)
double_task = stage(double, process=True)
grow_task = stage(grow)
fail_task = stage(fail, process=True)
die_task = stage(die, process=True)
"""


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """A data folder of this module's own, and the fake stages on the path of child processes."""
    folder = tmp_path_factory.mktemp("data")
    (folder / "fake_stages.py").write_text(STAGES)
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("DCAP_DATA", str(folder))
        patch.setenv("PYTHONPATH", str(folder))
        patch.syspath_prepend(str(folder))
        yield folder


@pytest.fixture(scope="module")
def fake(data: Path) -> ModuleType:
    """The fake stages."""
    import importlib

    return importlib.import_module("fake_stages")


@pytest.fixture(scope="module")
def server(data: Path) -> Iterator[str]:
    """A Prefect server for this module."""
    from flows.server import prefect_server

    with pytest.MonkeyPatch.context() as patch:
        patch.delenv("PREFECT_API_URL", raising=False)
        with prefect_server() as url:
            yield url


def run(fake: ModuleType, seed: int, **settings: object) -> tuple[Ref[Any], list[tuple[str, Event]]]:
    """make, then double, as a flow; what was returned and what happened."""
    from prefect import Flow

    from dcap.scene.types.sample import SourceOptions

    events: list[tuple[str, Event]] = []

    def note(event: StageEvent) -> None:
        events.append((event.stage, event.event))

    def chain() -> Ref[Any]:
        return fake.double_task(fake.make_task(seed, SourceOptions()))

    with use_context(RunContext(on_event=note, **settings)):  # type: ignore[arg-type]
        return Flow(chain, name="chain")(), events


def outcome(events: list[tuple[str, Event]]) -> dict[str, Event]:
    """How each stage ended."""
    return {stage: event for stage, event in events if event in (Event.FINISHED, Event.CACHED)}


def test_infeasible_passes_through(fake: ModuleType) -> None:
    """A stage that is given an Infeasible returns that same reference and runs nothing."""
    ref = Store.default().save(Infeasible(Reason.NO_SUPPORT_HIT, "the ray met nothing", None))
    assert fake.double_task(ref) == ref


def test_what_all_samples_share_is_held_once(fake: ModuleType, server: str) -> None:
    """A record that was looked up has the digests of the code that the stage holds, not a copy for each sample."""
    from prefect import Flow

    told: list[dict[str, object]] = []

    def note(event: StageEvent) -> None:
        if event.record is not None:
            told.append(event.record.deciders)

    def make() -> None:
        fake.make_task(771, SourceOptions())

    with use_context(RunContext(on_event=note)):
        Flow(make)()
    with use_context(RunContext(on_event=note, lookup_only=True)):
        make()
    computed, looked_up = told
    assert looked_up == computed
    assert looked_up["code"] is fake.make_task.code()


def test_looking_up_runs_nothing(fake: ModuleType) -> None:
    """With lookup_only, a stage without a record raises and says what it would be made from."""
    from dcap.scene.types.sample import SourceOptions

    with use_context(RunContext(lookup_only=True)), pytest.raises(NotCachedError) as caught:
        fake.make_task(77, SourceOptions())
    assert caught.value.deciders.stage == "make"
    why = in_words(why_not_cached(caught.value.deciders, Store.default()))
    assert why == "never computed" or why.startswith("seed changed (")


def test_a_default_is_the_same_given_or_left_out(fake: ModuleType) -> None:
    """Two callers of a stage share its results although one of them names a parameter's default."""

    mesh = Store.default().save(Mesh.of([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]))

    def wanted(**given: object) -> str:
        with use_context(RunContext(lookup_only=True)), pytest.raises(NotCachedError) as caught:
            fake.grow_task(mesh, **given)
        return caught.value.deciders.key

    assert wanted() == wanted(factor=None) == wanted(config=fake.MakeConfig()) != wanted(factor=1.0)


def test_the_key_holds_what_decides(fake: ModuleType) -> None:
    """Seed, options and settings change the key; the number of threads does not."""
    from dcap.scene.types.sample import SourceOptions

    def key(seed: int, options: SourceOptions, **config: object) -> str:
        inputs = {"seed": seed, "options": options}
        return fake.make_task.deciders(inputs, fake.MakeConfig(**config)).key

    base = key(0, SourceOptions())
    assert base == key(0, SourceOptions(), threads=7)
    others = {key(1, SourceOptions()), key(0, SourceOptions(up="y")), key(0, SourceOptions(), size=2.0)}
    assert len(others - {base}) == 3
    assert key(0, SourceOptions(), size=0.0) != key(0, SourceOptions(), size=-0.0)  # equal, and divided by not the same


def test_an_input_of_another_kind_is_refused(fake: ModuleType) -> None:
    """A stage that is handed an artifact of a kind that it does not declare says both names and runs nothing."""
    ref = Store.default().save(Material("foam", 30.0, 1e4, 0.3, 0.6, 0.5, 0.0, "soft", "test"))
    with pytest.raises(StoreError, match="input mesh is declared Mesh, its artifact is a Material"):
        fake.double_task.load({"mesh": {"ref": ref.to_json()}}, None, Session())


@pytest.mark.slow
def test_second_run_is_cached(server: str, fake: ModuleType) -> None:
    """The first run computes both stages, the second none, and both return the same."""
    first, events = run(fake, 1)
    assert outcome(events) == {"make": Event.FINISHED, "double": Event.FINISHED}
    assert ("double", Event.PROGRESS) in events
    second, events = run(fake, 1)
    assert outcome(events) == {"make": Event.CACHED, "double": Event.CACHED}
    assert second == first
    mesh = Store.default().load(second)
    assert isinstance(mesh, Mesh)
    np.testing.assert_array_equal(mesh.vertices, 2.0 * np.random.default_rng(1).random((30, 3)))


@pytest.mark.slow
@pytest.mark.parametrize(("damaged", "how"), [
    ("make", "flip"), ("double", "delete"),
    *(pytest.param(*each, marks=pytest.mark.long) for each in (("make", "delete"), ("double", "flip"))),
])  # fmt: skip
def test_damage_recomputes_just_that_stage(server: str, fake: ModuleType, damaged: str, how: str) -> None:
    """A deleted or corrupted artifact is computed again, the other stage stays cached, the result is the same."""
    seed = 10 + 2 * (damaged == "make") + (how == "flip")
    first, _ = run(fake, seed)
    store = Store.default()
    keys = {path.name.split("-")[0]: path for path in newest_records()}
    record = read_record(keys[damaged])
    assert record is not None
    file = next(store.folder(record.ref).glob("*.ply"))
    if how == "delete":
        file.unlink()
    else:
        data = bytearray(file.read_bytes())
        data[-1] ^= 1
        file.write_bytes(data)
    again, events = run(fake, seed)
    assert again == first
    expected = {"make": Event.CACHED, "double": Event.CACHED} | {damaged: Event.FINISHED}
    assert outcome(events) == expected
    assert outcome(run(fake, seed)[1]) == {"make": Event.CACHED, "double": Event.CACHED}


def newest_records() -> list[Path]:
    """Records, newest last."""
    return sorted(records_root().iterdir(), key=lambda path: path.stat().st_mtime_ns)


@pytest.mark.slow
def test_a_damaged_record_is_passed_over(server: str, fake: ModuleType) -> None:
    """A record that is cut short counts as no record: the stage runs again under the next name."""
    first, _ = run(fake, 30)
    path = newest_records()[-1]
    path.write_bytes(path.read_bytes()[:40])
    assert usable_key(path.name, Store.default()) == (f"{path.name}-r1", None)
    again, events = run(fake, 30)
    assert again == first
    assert outcome(events) == {"make": Event.CACHED, "double": Event.FINISHED}


@pytest.mark.slow
def copied(one: Path, other: Path) -> None:
    one.write_bytes(other.read_bytes())


def linked(one: Path, other: Path) -> None:
    one.unlink()
    one.symlink_to(other.name)


def looped(one: Path, other: Path) -> None:
    one.unlink()
    one.symlink_to(one.name)


def piped(one: Path, other: Path) -> None:
    one.unlink()
    os.mkfifo(one)


def a_folder(one: Path, other: Path) -> None:
    one.unlink()
    one.mkdir()


def nested(one: Path, other: Path) -> None:
    one.write_text('{"result": ' + "[" * 200_000)


def of_text(one: Path, other: Path) -> None:
    tree = json.loads(one.read_text())
    tree["result"] = json.dumps(json.loads(tree["result"]) | {"ref": "none", "size": "large"})
    one.write_text(json.dumps(tree))


def decoded(one: Path, other: Path) -> None:
    """Read through a function of the file's choice."""
    tree = json.loads(one.read_text())
    tree["metadata"]["serializer"]["object_decoder"] = "builtins.print"
    one.write_text(json.dumps(tree))


def of_a_class(one: Path, other: Path) -> None:
    """With a part that the decoder makes an object of."""
    tree = json.loads(one.read_text())
    tree["result"] = json.dumps(json.loads(tree["result"]) | {"more": [{"__class__": "pathlib.Path", "data": "/"}]})
    one.write_text(json.dumps(tree))


DAMAGES = (copied, linked, looped, piped, a_folder, nested, of_text, decoded, of_a_class)


@pytest.mark.parametrize(("seed", "damage"), list(enumerate(DAMAGES)))
def test_another_records_place_gives_no_others_result(
    server: str, fake: ModuleType, seed: int, damage: Callable[[Path, Path], None]
) -> None:
    seed += 100
    own, other = (fake.make_task(one, SourceOptions()) for one in (seed, seed + 100))
    keys = [fake.make_task.deciders({"seed": one, "options": SourceOptions()}, fake.MakeConfig()).key
            for one in (seed, seed + 100)]  # fmt: skip
    damage(records_root() / keys[0], records_root() / keys[1])
    assert usable_key(keys[0], Store.default()) == (f"{keys[0]}-r1", None)
    assert fake.make_task(seed, SourceOptions()) == own != other
    name, record = usable_key(keys[0], Store.default())
    assert record is not None
    assert (name, record.ref) == (f"{keys[0]}-r1", own)


def test_refresh_computes_one_stage_again(server: str, fake: ModuleType) -> None:
    """A refreshed stage runs; what follows stays cached because the new bytes are equal."""
    first, _ = run(fake, 40)
    again, events = run(fake, 40, refresh=frozenset({"make"}))
    assert again == first
    assert outcome(events) == {"make": Event.FINISHED, "double": Event.CACHED}


def job(function: str, data: Path) -> dict[str, object]:
    """A job for a child process."""
    ref = Store.default().save(Mesh.of(np.zeros((3, 3)), [[0, 1, 2]]))
    return {
        "module": "fake_stages",
        "function": function,
        "inputs": {"mesh": {"ref": ref.to_json()}},
        "config": None,
        "session": {},
    }


def test_a_child_reports_result_and_progress(data: Path) -> None:
    """A stage in its own process returns a reference and passes on what our code logs, not what libraries print."""
    heard: list[tuple[float, str]] = []
    done = run_in_process(job("double", data), lambda part, text: heard.append((part, text)))
    assert done["ref"]["kind"] == "Mesh"
    assert heard == [(0.5, "half way")]


def test_a_childs_error_keeps_its_type(data: Path) -> None:
    """An error on purpose crosses the process border under its own type and with its message."""
    with pytest.raises(GeometryError, match="30 vertices > 10"):
        run_in_process(job("fail", data), lambda part, text: None)


def test_a_crash_stays_in_the_child(data: Path) -> None:
    """A child that aborts is an error here that names the signal and its last words."""
    with pytest.raises(StageProcessError, match=r"SIGABRT(.|\n)*last words"):
        run_in_process(job("die", data), lambda part, text: None)


def test_a_child_dies_with_its_parent(tmp_path: Path) -> None:
    """Killing the parent with SIGKILL ends the stage's process at once."""
    (tmp_path / "fake_sleep.py").write_text(
        textwrap.dedent("""
        import os, time, pathlib
        def nap(path: str) -> str:
            pathlib.Path(path).write_text(str(os.getpid()))
            time.sleep(60)
        """)
    )
    mark = tmp_path / "pid"
    work = {
        "module": "fake_sleep",
        "function": "nap",
        "inputs": {"path": {"value": str(mark)}},
        "config": None,
        "session": {},
    }
    program = f"from tasks.runner.process import run_in_process; run_in_process({work!r}, print)"
    root = str(Path(__file__).parents[3])
    environment = os.environ | {"PYTHONPATH": f"{root}{os.pathsep}{tmp_path}", "DCAP_DATA": str(tmp_path)}
    parent = subprocess.Popen([sys.executable, "-c", program], env=environment)
    wait_until(lambda: mark.exists() and mark.read_text() != "")
    parent.kill()
    parent.wait()
    wait_until(lambda: not alive(int(mark.read_text())))


def test_locks_exclude_and_let_go(tmp_path: Path) -> None:
    """One holder at a time; the lock of a killed process is free."""
    locks = FileLocks(tmp_path)
    assert locks.acquire_lock("a", "one")
    assert locks.is_locked("a")
    assert locks.is_lock_holder("a", "one")
    assert not locks.acquire_lock("a", "two", acquire_timeout=0)
    locks.release_lock("a", "one")
    assert locks.acquire_lock("a", "two", acquire_timeout=0)
    locks.release_lock("a", "two")
    program = (
        f"import os; from pathlib import Path; from tasks.runner.locks import FileLocks;"
        f"FileLocks(Path({str(tmp_path)!r})).acquire_lock('b', 'x'); os.kill(os.getpid(), 9)"
    )
    root = str(Path(__file__).parents[3])
    subprocess.run([sys.executable, "-c", program], env=os.environ | {"PYTHONPATH": root}, check=False)
    assert locks.acquire_lock("b", "one", acquire_timeout=0)
