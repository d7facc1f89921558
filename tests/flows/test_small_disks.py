"""A disk that is too small, gets full, or cannot be written: one line names it, and with room the next run goes on."""

import json
import subprocess
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import NamedTuple

import pytest
from desk_room import desk_dataset
from kept_records import kept_records
from watched_run import PATIENCE, TELL, begun_stages, finished, result, results, server_elsewhere, started

from tasks.artifact import Store
from flows.server import LEAST_ROOM
from tasks.runner.damage import damages

FILL = """
        import os
        with (Path(os.environ["FULL_DISK"]) / "ballast").open("wb", 0) as file:
            for size in (1 << 20, 1 << 12):
                try:
                    while file.write(bytes(size)) == size:
                        pass
                except OSError:
                    pass
"""
FILL_DATABASE = """
        import json, urllib.error, urllib.request, uuid
        answer = 200
        while answer < 500:
            body = json.dumps({"name": uuid.uuid4().hex, "tags": ["x" * 100_000]}).encode()
            url = os.environ["PREFECT_API_URL"] + "/flows/"
            try:
                urllib.request.urlopen(urllib.request.Request(url, body, {"content-type": "application/json"}))
            except urllib.error.HTTPError as error:
                answer = error.code
"""
"""What its file still takes on a full disk; then the server answers 500."""
DISK_BYTES = 48 << 20
"""What a run of one sample and its server write is 15 MB; the ballast takes the rest."""
Mount = Callable[..., None]


class Whole(NamedTuple):
    """What nobody has disturbed."""

    data: Path
    place: tuple[object, object]
    benchmark: dict[str, object]


@pytest.fixture(autouse=True)
def small_pictures(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing here is seen in them."""
    monkeypatch.setenv("DCAP_RENDER__SIZE", "256")


@pytest.fixture(scope="module")
def whole(tmp_path_factory: pytest.TempPathFactory) -> Whole:
    """A benchmark, and a placement of the same things."""
    folder = tmp_path_factory.mktemp("whole")
    data, out = folder / "data", folder / "out"
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("DCAP_RENDER__SIZE", "256")
        for command in ("benchmark", "place"):
            finished(started(folder, data, "", "", TELL, *words(command, folder, out)))
    return Whole(data, result(out), results(data))


@pytest.fixture
def mounted() -> Iterator[Mount]:
    """Mounts a disk of so many bytes; skips where that is not allowed."""
    with ExitStack() as mounts:

        def mount(place: Path, size: int = DISK_BYTES) -> None:
            place.mkdir(parents=True)
            command = ["mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", str(place)]
            try:
                refused = subprocess.run(command, capture_output=True, text=True, check=False).stderr
            except OSError as error:
                refused = str(error)
            if refused:
                pytest.skip(f"no disk can be mounted here: {refused.strip()}")
            mounts.callback(subprocess.run, ["umount", "--lazy", str(place)], check=True)

        yield mount


def words(command: str, folder: Path, out: Path) -> tuple[str, ...]:
    """A command that puts a mug on a desk."""
    dataset = desk_dataset(folder, {"mug": "put the mug on the desk"})
    return {
        "place": ("place", "room.glb", "mug.glb", "put the mug on the desk", "--out", str(out)),
        "benchmark": ("benchmark", "--dataset", str(dataset), "--workers", "1"),
    }[command]


def refusal(process: "subprocess.Popen[str]") -> str:
    """The one line with which a program ends, without a traceback and with nothing of Prefect's."""
    _, err = process.communicate(timeout=PATIENCE)
    assert process.returncode == 2, err
    assert "Traceback" not in err
    assert "Error logging" not in err
    (line,) = (one.partition("dcap: ")[2] for one in err.splitlines() if "dcap: " in one)
    return line


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.timeout(1800)
@pytest.mark.parametrize(
    ("command", "full", "server"),
    [
        ("place", "", "elsewhere"),
        ("benchmark", "", "elsewhere"),
        ("place", "", "on it"),
        ("benchmark", "", "on it"),
        ("place", "cache/prefect", "on it"),
    ],
)
def test_a_disk_that_is_full_in_the_middle_is_told(
    mounted: Mount,
    whole: Whole,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    command: str,
    full: str,
    server: str,
) -> None:
    """The program ends with a line that names the disk, and leaves nothing half-written; once there is room, the next
    one finishes with the results of one that nobody has disturbed, and what was done before is not done again."""
    data = tmp_path / "disk"
    mounted(disk := data / full)
    out = data / "out"
    monkeypatch.setenv("FULL_DISK", str(disk))
    asked = words(command, tmp_path, out)
    with ExitStack() as running:
        url = running.enter_context(server_elsewhere(tmp_path / "server")) if server == "elsewhere" else ""
        fill = FILL if url else FILL + FILL_DATABASE
        line = refusal(started(tmp_path, data, url, "drop", fill.strip(), *asked))
        assert str(disk) in line
        assert " 0 MiB" in line
        assert not out.exists()
        for path in (data / "runs").rglob("*.json"):
            json.loads(path.read_bytes())
        monkeypatch.setenv("DCAP_DATA", str(data))
        assert damages(Store(data / "cache" / "store")) == []

        (disk / "ballast").unlink()
        before = kept_records(data)
        assert begun_stages(tmp_path)[0] == "particles"
        finished(started(tmp_path, data, url, "", TELL, *asked))
    assert kept_records(data).items() >= before.items()
    assert "particles" not in begun_stages(tmp_path)
    if command == "place":
        assert result(out) == whole.place
    else:
        assert results(data) == whole.benchmark


@pytest.mark.slow
@pytest.mark.parametrize("command", ["place", "benchmark"])
def test_a_disk_without_room_for_the_server_is_told(mounted: Mount, tmp_path: Path, command: str) -> None:
    """Before one is started: a database that gets half of what it needs tells nobody what is wrong."""
    mounted(data := tmp_path / "disk", LEAST_ROOM // 2)
    line = refusal(started(tmp_path, data, "", "", TELL, *words(command, tmp_path, tmp_path / "out")))
    assert line.startswith(f"{data / 'cache' / 'prefect'}: 3 MiB are free, too few for Prefect's database; make room")
    assert "DCAP_DATA" in line
    assert begun_stages(tmp_path) == []
    assert not list(data.rglob("prefect.db*"))


@pytest.mark.slow
@pytest.mark.parametrize("command", ["place", "benchmark"])
def test_a_data_folder_that_is_read_only_is_told(mounted: Mount, tmp_path: Path, command: str) -> None:
    """The line names the folder and what chooses it."""
    mounted(data := tmp_path / "disk")
    subprocess.run(["mount", "-o", "remount,ro", str(data)], check=True)
    line = refusal(started(tmp_path, data, "", "", TELL, *words(command, tmp_path, tmp_path / "out")))
    assert line.startswith(str(data))
    assert line.endswith(
        f"Read-only file system; change its permissions, or name another place with DCAP_DATA (now {data})"
    )
    assert not (tmp_path / "out").exists()
