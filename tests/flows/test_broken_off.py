"""A run that is killed in the middle of a stage, or whose server is: the next goes on, and ends as any other."""

import json
import signal
from collections.abc import Iterator
from pathlib import Path

import pytest
from desk_room import desk_dataset
from kept_records import Stamp, kept_records
from process_trees import descendants
from watched_run import TELL, begun_stages, finished, results, server_elsewhere, started, wait_until

STAGES = ["particles", "drop", "render", "measure", "judged_views", "drift"]
"""Functions of the stages that have a process of their own, in their order; `mesh` has one for splats only."""
KILL_SERVER = """
        import json, os, signal
        from kept_records import kept_records
        data, mark = Path(os.environ["DCAP_DATA"]), folder / f"killed in {job['function']}"
        if not mark.exists():
            mark.write_text(json.dumps(kept_records(data)))
            pid = json.loads((data / "cache" / "prefect" / "server.json").read_text())["pid"]
            (folder / f"server in {job['function']}").write_text(str(pid))
            os.kill(pid, signal.SIGKILL)
"""


@pytest.fixture
def url(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[str]:
    """A server for all programs of a test."""
    monkeypatch.setenv("DCAP_RENDER__SIZE", "256")  # nothing here is seen in the pictures
    with server_elsewhere(tmp_path / "server") as one:
        yield one


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.timeout(1800)
def test_a_run_that_is_killed_in_any_stage_goes_on(tmp_path: Path, url: str) -> None:
    """Killed in each stage that has a process, one after another, no process stays, and what was done before is not
    done again; the last run's results are those of one that nobody has disturbed, digest by digest."""
    dataset = desk_dataset(tmp_path, {"mug": "put the mug on the desk"})
    words = ("benchmark", "--dataset", str(dataset), "--workers", "1", "--methods", "dcap,no_drop")
    whole, broken = tmp_path / "whole", tmp_path / "broken"
    finished(started(tmp_path, whole, url, "", TELL, *words))
    assert list(dict.fromkeys(begun_stages(tmp_path))) == STAGES

    done: dict[str, Stamp] = {}
    for stage in STAGES:
        (tmp_path / "begun").unlink(missing_ok=True)
        run = started(tmp_path, broken, url, stage, TELL, *words)
        try:
            wait_until(lambda run=run: (tmp_path / "begun").exists() or run.poll() is not None)  # type: ignore[misc]
            family = descendants(run.pid)
        finally:
            run.send_signal(signal.SIGKILL)
            run.communicate()
        assert run.returncode == -signal.SIGKILL
        wait_until(lambda family=family: not any(map(lives, family)), seconds=30.0)  # type: ignore[misc]
        assert len(family) > 1
        assert begun_stages(tmp_path)[-1] == stage
        now = kept_records(broken)
        assert now.items() >= done.items()
        assert kept_records(whole).keys() > now.keys()  # the stage itself is not done
        done = now
    finished(started(tmp_path, broken, url, "", TELL, *words))
    assert kept_records(broken).items() >= done.items()
    assert kept_records(broken).keys() == kept_records(whole).keys()
    assert results(broken) == results(whole)


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.timeout(1800)
def test_a_slot_of_a_killed_run_comes_back(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of the only simulation that may run: its server is gone with the run, and the next one does not wait for ever."""
    dataset = desk_dataset(tmp_path, {"mug": "put the mug on the desk"})
    monkeypatch.setenv("DCAP_RUN__SIMULATIONS", "1")
    words = ("benchmark", "--dataset", str(dataset), "--workers", "1")
    run = started(tmp_path, tmp_path / "data", "", "drop", TELL, *words)
    wait_until(lambda: (tmp_path / "begun").exists() or run.poll() is not None)
    run.send_signal(signal.SIGKILL)
    run.communicate()
    assert run.returncode == -signal.SIGKILL
    finished(started(tmp_path, tmp_path / "data", "", "", TELL, *words))


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("killed", [("particles", "render"), ("drop", "measure")], ids=" and ".join)
def test_a_run_whose_server_is_killed_in_stages_ends_as_any_other(
    tmp_path: Path, url: str, killed: tuple[str, ...]
) -> None:
    """The server is started again and the sample begins again; no stage is computed twice, and the results are those of
    a run that nobody has disturbed, digest by digest."""
    dataset = desk_dataset(tmp_path, {"mug": "put the mug on the desk"})
    words = ("benchmark", "--dataset", str(dataset), "--workers", "1")
    whole, broken = tmp_path / "whole", tmp_path / "broken"
    finished(started(tmp_path, whole, url, "", TELL, *words))
    stages = begun_stages(tmp_path)
    finished(started(tmp_path, broken, "", ",".join(killed), KILL_SERVER, *words))
    assert begun_stages(tmp_path) == stages  # once each, those in which it was killed included
    servers = {(tmp_path / f"server in {stage}").read_text() for stage in killed}
    assert len(servers) == len(killed)  # each time another: the last one killed may not have got so far as to answer
    for stage in killed:
        before = json.loads((tmp_path / f"killed in {stage}").read_text())
        assert kept_records(broken).items() >= {name: tuple(stamp) for name, stamp in before.items()}.items()
    assert kept_records(broken).keys() == kept_records(whole).keys()
    assert results(broken) == results(whole)


def lives(pid: int) -> bool:
    """Whether a process is there that is no zombie."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False
