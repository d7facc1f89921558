"""The command line keeps the contract's exit codes and complains in one line."""

import errno
import os
import re
import subprocess
import sys
from pathlib import Path
from unittest.mock import Mock

import pytest

import dcap
from dcap.scene.errors import MachineError
from dcap.scene.written_files import draft_folder
from flows.cli.app import exit_code, main
from flows.configure import configured
from flows.options import PlaceOptions
from tasks.cache import deciding
from tasks.machine_errors import as_machine_errors


def failed(capsys: pytest.CaptureFixture[str], *arguments: str) -> str:
    """What a refused command line says."""
    code = main(list(arguments))
    captured = capsys.readouterr()
    assert code == 2
    assert captured.out == ""
    assert captured.err.count("\n") == 1
    assert captured.err.startswith("dcap: ")
    return captured.err


BAD_USAGE = [
    (["place", "a", "b", "c", "--bogus"], "--bogus"),
    (["--bogus"], "--bogus"),
    (["fly"], "fly"),
    (["place", "a"], "object"),
    (["place", "a", "b", "  "], "PROMPT is empty"),
    (["place", "a", "b", "c", "--mass", "-1"], "--mass"),
    (["place", "a", "b", "c", "--mass", "nan"], "--mass"),
    (["place", "a", "b", "c", "--up", "x"], "--up 'x' is not one of"),
    (["place", "a", "b", "c", "--unit", "ft"], "--unit 'ft'"),
    (["place", "a", "b", "c", "--seed", "one"], "--seed"),
    (["drop", "nothing.yaml", "--out", "out"], "nothing.yaml: no such file"),
    (["place", "a", "b", "c", "--arch", "gpu"], "--arch 'gpu' is not one of"),
    (["place", "a", "b", "c", "--stability", "--solver", "mls"], "--stability needs --solver tl"),
    (["place", "a", "b", "c", "--stability", "--method", "paper"], "cannot be combined with --stability"),
    (["place", "a", "b", "c", "--method", "paper", "--solver", "tl"], "leave out --solver"),
    (["place", "a", "b", "c", "--method", "magic"], "--method 'magic' is not one of"),
    (["benchmark", "--methods", "magic"], "--methods 'magic'"),
    (["benchmark", "--workers", "0"], "--workers"),
]
"""Command lines, and words that are said of each."""


def test_bad_usage(capsys: pytest.CaptureFixture[str], subtests: pytest.Subtests) -> None:
    """A command line that cannot be right exits with 2 and one line that names what is wrong."""
    for arguments, words in BAD_USAGE:
        with subtests.test(str(arguments)):
            assert words in failed(capsys, *arguments)


def test_a_graphics_card_that_is_not_there(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """`--arch cuda` is refused before anything is read; the processor does not silently take its place."""
    monkeypatch.setattr("solver.runtime.cuda_works", lambda: False)
    (tmp_path / "case.yaml").write_text("")
    assert "--arch cuda" in failed(capsys, "drop", str(tmp_path / "case.yaml"), "--out", "out", "--arch", "cuda")
    assert "--arch cuda" in failed(capsys, "place", "a", "b", "put it", "--out", "out", "--arch", "cuda")


def test_the_arch_decides_a_result() -> None:
    """Processors round differently, so a drop on one is no record for the other; threads are."""
    keys = [
        deciding(configured(PlaceOptions(threads=threads), arch=arch).drop.model_dump())
        for threads, arch in ((1, "cpu"), (2, "cpu"), (1, "cuda"))
    ]
    assert keys[0] == keys[1] != keys[2]


TOLD = {
    "verdict": "at_rest", "base": {"id": "bed_0", "label": "bed"}, "part": "mattress",
    "warnings": ["asked seated, found on its side"], "notes": ["mass 1 kg"],
}  # fmt: skip


@pytest.mark.parametrize(("option", "lines"), [((), []), (("--verbose",), ["note: mass 1 kg"])])
def test_a_placement_says_what_asks_for_action(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, option: tuple[str, ...],
    lines: list[str],
) -> None:  # fmt: skip
    """Where it rests and its warnings are printed; what only explains it is printed if asked for."""
    monkeypatch.setattr("flows.place_one.place_files", Mock(return_value=TOLD))
    assert main(["place", "a", "b", "put it", "--out", str(tmp_path), *option]) == 0
    captured = capsys.readouterr()
    assert captured.out.splitlines() == ["at rest on bed (mattress)", f"results: {tmp_path}"]
    assert captured.err.splitlines() == ["warning: asked seated, found on its side", *lines]


def test_the_version(capsys: pytest.CaptureFixture[str]) -> None:
    """--version prints the version of the package and ends."""
    assert main(["--version"]) == 0
    assert capsys.readouterr().out == f"dcap {dcap.__version__}\n"


def obj_of(vertices: str, faces: str) -> bytes:
    """An OBJ file."""
    return (vertices + faces).encode()


CUBE = "".join(f"v {x} {y} {z}\n" for x in (0, 2) for y in (0, 2) for z in (0, 2))
SIDES = "f 1 2 4 3\nf 5 7 8 6\nf 1 5 6 2\nf 3 4 8 7\nf 1 3 7 5\nf 2 6 8 4\n"
TRUNCATED = b"ply\nformat binary_little_endian 1.0\nelement vertex 1000000000\nproperty float x\nproperty float y\n"


@pytest.fixture(scope="module")
def data_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One for several programs."""
    return tmp_path_factory.mktemp("data")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "content", "words"),
    [
        ("nan.obj", obj_of("v 0 0 nan\nv 1 0 0\nv 0 1 0\n", "f 1 2 3\n"), "not finite"),
        pytest.param("empty.obj", b"", "an empty file", marks=pytest.mark.long),
        pytest.param("short.ply", TRUNCATED + b"property float z\nend_header\n", "1000000000", marks=pytest.mark.long),
        pytest.param("gone.glb", None, "no such file", marks=pytest.mark.long),
    ],
)
def test_meshes_that_cannot_be_used(
    tmp_path: Path, data_folder: Path, name: str, content: bytes | None, words: str
) -> None:  # fmt: skip
    """Exit 2 and one line that names the file and what is wrong with it, through the whole program in a process of its
    own: where results are kept is decided once per process. What readers refuse is tested with them."""
    room = tmp_path / "room.obj"
    room.write_bytes(obj_of(CUBE, SIDES))
    if content is not None:
        (tmp_path / name).write_bytes(content)
    command = [sys.executable, "-m", "flows.cli", "place", str(room), str(tmp_path / name), "put it on the table"]
    done = subprocess.run(
        [*command, "--label", "table", "--json"], capture_output=True, text=True,
        env=os.environ | {"DCAP_DATA": str(data_folder)},
    )  # fmt: skip
    said = done.stderr
    assert (done.returncode, done.stdout, said.count("\n")) == (2, "", 1)
    assert name in said
    assert words in said


FLOOR_AND_WALL = """o floor
v 0 0 0
v 2 0 0
v 2 2 0
v 0 2 0
v -1 0 0
v -1 2 0
v -1 2 2
v -1 0 2
f 1 2 3 4
o wall
f 5 6 7 8
"""


def test_a_point_with_nothing_below_it_is_refused_by_the_process_too(tmp_path: Path, data_folder: Path) -> None:
    """Exit 2 and an empty standard output: what was being computed when it was found out is let go before the end."""
    (tmp_path / "room.obj").write_text(FLOOR_AND_WALL)
    (tmp_path / "cube.obj").write_bytes(obj_of(CUBE, SIDES))
    command = [sys.executable, "-m", "flows.cli", "place", str(tmp_path / "room.obj"), str(tmp_path / "cube.obj")]
    done = subprocess.run(
        [*command, "put it there", "--up", "z", "--unit", "m", "--at=-0.5,1,0.5"], capture_output=True, text=True,
        env=os.environ | {"DCAP_DATA": str(data_folder)}, cwd=tmp_path,
    )  # fmt: skip
    assert (done.returncode, done.stdout) == (2, "")
    assert "nothing below it" in done.stderr.splitlines()[-1]


@pytest.mark.parametrize("out", ["file", "file/below", "file/far/below"])
def test_out_must_be_a_folder(capsys: pytest.CaptureFixture[str], tmp_path: Path, out: str) -> None:
    """A result folder that is a file, or would lie below one, is refused before anything runs."""
    (tmp_path / "file").write_text("")
    said = failed(capsys, "place", "a", "b", "put it", "--out", str(tmp_path / out))
    assert f"{tmp_path / 'file'} is a file" in said


@pytest.mark.skipif(sys.platform != "linux", reason="no /proc")
def test_out_must_be_writable(capsys: pytest.CaptureFixture[str]) -> None:
    """Also where the rights of the folder say so and its file system does not."""
    assert "--out /proc/results: /proc is not writable" in failed(
        capsys, "place", "a", "b", "put it", "--out", "/proc/results"
    )


def test_a_full_disk_is_no_wrong_option(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The line tells the room that is left."""
    full = OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), str(tmp_path / "x"))
    monkeypatch.setattr("tempfile.TemporaryDirectory", Mock(side_effect=full))
    said = failed(capsys, "place", "a", "b", "put it", "--out", str(tmp_path / "out"))
    assert f"MiB in its folder ({tmp_path})" in said


def test_a_disk_that_fills_up_is_named(tmp_path: Path) -> None:
    """The system does not say on which disk a file was that it had opened before."""
    words = re.escape(f"{tmp_path}: {os.strerror(errno.ENOSPC)}") + ".*" + re.escape(f"MiB in its folder ({tmp_path})")
    with pytest.raises(MachineError, match=words), as_machine_errors(), draft_folder(tmp_path):
        Path("/dev/full").write_bytes(b"x")


def test_help_is_not_an_error(capsys: pytest.CaptureFixture[str]) -> None:
    """--help exits with 0 and prints on standard output."""
    assert main(["place", "--help"]) == 0
    assert "--object-up" in capsys.readouterr().out


def test_an_empty_cache(capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """`cache ls` and `cache verify` work where nothing has been computed."""
    monkeypatch.setenv("DCAP_DATA", str(tmp_path))
    assert main(["cache", "ls"]) == 0
    assert main(["cache", "verify"]) == 0
    assert "0 artifacts, 0 records, 0 damaged" in capsys.readouterr().out


def test_a_prompt_that_is_no_text(capsys: pytest.CaptureFixture[str]) -> None:
    """A byte that the terminal did not decode is refused, not a traceback."""
    assert "UTF-8" in failed(capsys, "place", "a", "b", "put it \udcff there")


def test_the_exit_code_of_a_placement() -> None:
    """What a method poses without physics is done, as what is at rest; `place` and `rerun` say so."""
    codes = {
        verdict: exit_code({"verdict": verdict}) for verdict in ("at_rest", "as_posed", "infeasible", "no_equilibrium")
    }
    assert codes == {"at_rest": 0, "as_posed": 0, "infeasible": 3, "no_equilibrium": 3}
