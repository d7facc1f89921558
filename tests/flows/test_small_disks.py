"""A disk that gets full, or cannot be written: one line names it, and with room the next run goes on."""

import os
import subprocess
from collections.abc import Callable, Iterator
from contextlib import ExitStack, suppress
from pathlib import Path

import pytest
from small_stages import chain, computed

from flows.cli.app import main
from tasks.artifact import Store
from tasks.upkeep import damages

DISK_BYTES = 4 << 20
Mount = Callable[..., None]


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


@pytest.mark.slow
def test_a_disk_that_gets_full_leaves_nothing_half_written(
    mounted: Mount, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Once there is room, the stages go on; what was done before is not done again."""
    mounted(tmp_path / "disk")
    monkeypatch.setenv("DCAP_DATA", str(tmp_path / "disk"))
    chain(0)
    with (tmp_path / "disk" / "ballast").open("wb", 0) as file, suppress(OSError):
        while True:
            file.write(bytes(1 << 12))
    with pytest.raises(OSError, match="No space"):
        chain(1)
    (tmp_path / "disk" / "ballast").unlink()
    assert damages() == []
    computed()
    chain(0)
    assert computed() == []
    chain(1)
    assert computed()[-1] == "paint"
    assert not list((Store.default().root / "building").iterdir())


@pytest.mark.slow
def test_a_data_folder_that_is_read_only_is_told(
    mounted: Mount, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """The line names the folder and what chooses it."""
    mounted(data := tmp_path / "disk")
    subprocess.run(["mount", "-o", "remount,ro", str(data)], check=True)
    monkeypatch.setenv("DCAP_DATA", str(data))
    (tmp_path / "mug.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    mug = str(tmp_path / "mug.obj")
    assert main(["place", mug, mug, "put it down", "--out", str(tmp_path / "out")]) == 2
    said = capsys.readouterr().err.strip().splitlines()[-1]
    assert said.startswith(f"dcap: {data}")
    assert "DCAP_DATA" in said
    assert not os.path.lexists(tmp_path / "out")
