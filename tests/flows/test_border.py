"""What goes wrong outside of our code is one line at the command's border, and a mistake of ours a traceback."""

import errno
import os
import subprocess
import sys
from pathlib import Path
from unittest.mock import Mock

import pytest

import dcap
from dcap.scene.errors import InputError
from dcap.scene.settings import data_root
from flows.cli.app import main
from tasks.machine_errors import machine_error

ROOT = Path(__file__).resolve().parents[2]
SECRET = "sk-ant-abcdef123456"


def said(capsys: pytest.CaptureFixture[str], *arguments: object) -> str:
    """The one line of a command that fails."""
    code = main([str(one) for one in arguments])
    captured = capsys.readouterr()
    assert code == 2
    assert captured.err.count("\n") == 1
    assert captured.err.startswith("dcap: ")
    return captured.err


ERRORS = [
    (OSError(errno.ENOSPC, os.strerror(errno.ENOSPC)), ("No space left", "MiB in DCAP_DATA", "--out")),
    (OSError(errno.EDQUOT, os.strerror(errno.EDQUOT), "/data/x"), ("/data/x: ", "MiB in DCAP_DATA")),
    (OSError(errno.ENOSPC, os.strerror(errno.ENOSPC), "/from", None, "/to/x"), ("/to/x: ", "its folder (/to)")),
    (OSError(errno.EROFS, os.strerror(errno.EROFS), "/else/x"), ("/else/x: Read-only", "--out")),
    (PermissionError(errno.EACCES, os.strerror(errno.EACCES), b"/else/y"), ("/else/y: Permission", "permissions")),
    (OSError(errno.EMFILE, os.strerror(errno.EMFILE), "/x"), ("Too many open files", "ulimit -n", "--workers")),
    (OSError(errno.ENAMETOOLONG, os.strerror(errno.ENAMETOOLONG), "x" * 5000), ("too long", "shorter")),
    (ConnectionRefusedError(errno.ECONNREFUSED, os.strerror(errno.ECONNREFUSED)), ("Connection refused",)),
    (BrokenPipeError(errno.EPIPE, os.strerror(errno.EPIPE)), ("Broken pipe",)),
    (MemoryError("Unable to allocate 9.9 GiB"), ("out of memory (Unable", "--workers")),
    (MemoryError(), ("out of memory; close",)),
    (ImportError("libX.so: failed to map segment from shared object"), ("out of memory", "ulimit -v", "libX.so")),
    (subprocess.CalledProcessError(3, "ffmpeg"), ("ffmpeg", "exit status 3")),
    (RuntimeError("Failed to reach API at http://u:p@127.0.0.1/api"), ("Prefect server", "http://***@127")),
]
"""What the system raises, and words that are said of each."""


def test_the_machine_is_told_in_a_line(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, subtests: pytest.Subtests
) -> None:
    """Disk, rights, open files, memory, programs and the server: what, where, and what to change; exit code 2."""
    for error, words in ERRORS:
        monkeypatch.setattr("flows.cli.cache_report.cache_listing", Mock(side_effect=error))
        with subtests.test(str(error)):
            line = said(capsys, "cache", "ls")
            assert all(word in line for word in words), line
            assert len(line) < 1000


def test_the_server_is_known_by_its_errors(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Prefect's client speaks HTTP: its errors name the log, and the disk where that is full."""
    import httpx

    monkeypatch.setenv("DCAP_DATA", str(tmp_path))
    monkeypatch.delenv("PREFECT_API_URL", raising=False)
    assert "server.log" in str(machine_error(httpx.ConnectError("all connection attempts failed")))
    monkeypatch.setattr("tasks.machine_errors._free_space", lambda path: 3 << 20)
    assert f"3 MiB left: make room in {tmp_path / 'cache' / 'prefect'}" in str(
        machine_error(httpx.ReadTimeout("no answer"))
    )


def test_a_server_of_a_team_has_its_log_elsewhere(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Neither our own server's log nor our own disk is named for it, but its address, without who signs in there; one
    that we have started has ours, wherever its address stands."""
    import httpx

    monkeypatch.setenv("DCAP_DATA", str(tmp_path))
    monkeypatch.setenv("PREFECT_API_URL", "http://team:of-ours@192.0.2.7:4200/api")
    monkeypatch.setattr("tasks.machine_errors._free_space", lambda path: 3 << 20)
    line = str(machine_error(httpx.ConnectError("all connection attempts failed")))
    assert line.endswith("; PREFECT_API_URL names http://***@192.0.2.7:4200/api: see there, or unset the variable")
    monkeypatch.setattr("tasks.machine_errors._free_space", lambda path: 3 << 30)
    monkeypatch.setenv("DCAP_OWN_SERVER", "http://team:of-ours@192.0.2.7:4200/api")
    assert "server.log" in str(machine_error(httpx.ConnectError("all connection attempts failed")))


def test_the_knob_is_that_of_the_place(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """A path in the data folder is chosen by DCAP_DATA, any other by --out."""
    monkeypatch.setenv("DCAP_DATA", str(tmp_path / "data"))
    monkeypatch.setattr("tempfile.gettempdir", lambda: "/nowhere")
    for path, knob in ((tmp_path / "data" / "cache" / "x", "DCAP_DATA"), (tmp_path / "out", "--out")):
        assert f"with {knob}" in str(machine_error(OSError(errno.EROFS, "Read-only file system", str(path))))


def test_a_data_folder_that_is_none_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    """DCAP_DATA may be a file, or lie where no folder can be made."""
    monkeypatch.setenv("DCAP_DATA", "/etc/passwd")
    with pytest.raises(InputError, match="DCAP_DATA=/etc/passwd is a file; name a folder"):
        data_root()
    monkeypatch.setenv("DCAP_DATA", "/etc/passwd/data")
    line = str(machine_error(NotADirectoryError(errno.ENOTDIR, "Not a directory", "/etc/passwd/data/cache")))
    assert line.startswith("/etc/passwd/data/cache: Not a directory; DCAP_DATA (now /etc/passwd/data) must be")


@pytest.mark.parametrize(("given", "why"), [("", "requires authentication"), ("team:of-ours", "rejects the value")])
def test_a_log_in_that_is_missing_or_wrong_is_asked_for(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch, given: str, why: str
) -> None:
    """By the server and the variable that gives it; neither by what it holds nor by the address of a page on HTTP."""
    import httpx

    monkeypatch.setenv("PREFECT_API_URL", "http://192.0.2.7:4200/api")
    monkeypatch.setenv("PREFECT_API_AUTH_STRING", given)
    request = httpx.Request("GET", "http://192.0.2.7:4200/api/csrf-token")
    refused = httpx.HTTPStatusError("no", request=request, response=httpx.Response(401, request=request))
    monkeypatch.setattr("flows.cli.cache_report.cache_listing", Mock(side_effect=refused))
    line = said(capsys, "cache", "ls")
    assert all(word in line for word in ("http://192.0.2.7:4200/api ", why, "PREFECT_API_AUTH_STRING=")), line
    assert not any(word in line for word in ("of-ours", "https://")), line


def test_a_mistake_of_ours_keeps_its_traceback(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """What is no fault of the machine or the input is raised as it is."""
    monkeypatch.setattr("flows.cli.cache_report.cache_listing", lambda **_: dict[str, int]()["no such key"])
    with pytest.raises(KeyError, match="no such key"):
        main(["cache", "ls"])
    assert capsys.readouterr().err == ""


def test_an_interruption_is_a_line(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> None:
    """Ctrl-C ends a command with 130 and a word."""

    def interrupt(**_: object) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("flows.cli.cache_report.cache_listing", interrupt)
    assert main(["cache", "ls"]) == 130
    assert capsys.readouterr().err == "dcap: interrupted\n"


def test_lines_hold_neither_secrets_nor_what_steers_a_terminal(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """A key in a message is hidden, a colour or a turned direction of writing is shown as a sign."""
    monkeypatch.setenv("ANTHROPIC_API_KEY", "a-key-of-no-known-form")

    def fail(**_: object) -> None:
        raise dcap.InputError(f"{SECRET} a-key-of-no-known-form https://me:word@host/x \x1b[31m\u202eabc")

    monkeypatch.setattr("flows.cli.cache_report.cache_listing", fail)
    line = said(capsys, "cache", "ls")
    assert "***" in line
    assert not any(word in line for word in (SECRET, "a-key-of", "word@", "\x1b", "\u202e"))


def test_python_gets_the_same_errors(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """`dcap.drop` raises a MachineError, whose cause is the system's."""

    def fail(*_: object, **__: object) -> None:
        raise OSError(errno.ENOSPC, "No space left on device")

    (tmp_path / "case.yaml").write_text("bodies: []")
    monkeypatch.setattr("flows.place_one.drop_case", fail)
    with pytest.raises(dcap.MachineError, match="No space left on device; free space:") as caught:
        dcap.drop(tmp_path / "case.yaml", out=tmp_path / "out")
    assert isinstance(caught.value.__cause__, OSError)


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["place", "a", "b", "x" * 10_001], "PROMPT has 10001 characters, at most 10000 are allowed"),
        (["place", "a", "b", "put\x00it"], "PROMPT has the control character '\\x00' at place 4"),
        (["place", "a", "b", "put\x1b[2J"], "control character '\\x1b'"),
        (["place", "a", "b", "put it", "--label", "t" * 1001], "has 1001 characters"),
        (["place", "a", "b", "put it", "--object-label", "a\x07"], "control character"),
        (["place", "a", "b", "put it", "--at", "1," * 5000], "characters"),
        (["place", "a", "b", "put it", "--out", "x" * 256], "more than 255 bytes"),
        (["place", "a", "b", "put it", "--out", "x\0y"], "null byte"),
        (["place", "a", "b", "put it", "--out", "x/" * 2000], "its path has more than 3500 bytes"),
        (["place", "a", "b", "put it", "--seed", "9" * 30], "--seed"),
        (["place", "a\udcff.glb", "b", "put it"], "argument 2, 'a\\udcff.glb', is not valid UTF-8"),
        (["view", "a", "--object", "b", "--prompt", "x" * 10_001], "PROMPT has 10001"),
    ],
)
def test_text_without_measure_is_refused(capsys: pytest.CaptureFixture[str], arguments: list[str], words: str) -> None:
    """Before anything is read, in a short line."""
    line = said(capsys, *arguments)
    assert words in line
    assert len(line) < 500


def test_python_refuses_the_same_text(tmp_path: Path) -> None:
    """What a shell cannot hand over, a program can."""
    with pytest.raises(dcap.InputError, match="a name in it has a zero byte"):
        dcap.place("a", "b", "put it", out="x\0y")
    with pytest.raises(dcap.InputError, match="PROMPT has 10001 characters"):
        dcap.place("a", "b", "x" * 10_001)
    with pytest.raises(dcap.InputError, match=r"--label .* has the control character"):
        dcap.place("a", "b", "put it", label="a\0", out=tmp_path)


def shell(tmp_path: Path, words: str, *, buffered: bool) -> subprocess.CompletedProcess[str]:
    """`dcap WORDS` of the shell, status and messages."""
    command = f"{sys.executable} {'' if buffered else '-u'} -m flows.cli {words}"
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONUNBUFFERED"}
    return subprocess.run(
        ["bash", "-c", command], cwd=ROOT, env=environment | {"DCAP_DATA": str(tmp_path)}, capture_output=True,
        text=True, check=False,
    )  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("buffered", [True, False])
def test_a_reader_that_leaves_ends_the_program_without_a_word(tmp_path: Path, buffered: bool) -> None:
    """`dcap ... | true`: no traceback, and the status of a broken pipe."""
    done = shell(tmp_path, 'place --help | (exec 0<&-; sleep 3); echo "${PIPESTATUS[0]}"', buffered=buffered)
    assert done.stderr == ""
    assert done.stdout == "141\n"


@pytest.mark.slow
@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="only Linux has a device that is full")
@pytest.mark.parametrize(
    ("buffered", "words"), [(True, "standard output: No space left on device"), (False, "No space left")]
)
def test_output_that_cannot_be_written_is_told(tmp_path: Path, buffered: bool, words: str) -> None:
    """Standard output on a full disk: one line and exit code 2."""
    done = shell(tmp_path, "cache ls > /dev/full", buffered=buffered)
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert words in done.stderr


@pytest.mark.parametrize(
    ("arguments", "line"),
    [
        (("benchmark", "--workers", "many"), "--workers 'many' is not a whole number"),
        (("benchmark", "--workers", "1.5"), "--workers '1.5' is not a whole number"),
        (("benchmark", "--workers", "0"), "--workers '0' is less than 1"),
        (("benchmark", "--workers", "65"), "--workers '65' is more than 64"),
        (("place", "a", "b", "c", "--mass", "heavy"), "--mass 'heavy' is not a number"),
        (("ui", "--port", "a\nb\x1b"), r"--port 'a\nb\x1b' is not a whole number"),
    ],
)
def test_a_value_that_an_option_does_not_take(
    capsys: pytest.CaptureFixture[str], arguments: tuple[str, ...], line: str
) -> None:
    """The option, the value and what it lacks."""
    assert said(capsys, *arguments) == f"dcap: {line}\n"


def test_a_long_value_is_cut(capsys: pytest.CaptureFixture[str]) -> None:
    """One line stays one that a person reads."""
    assert len(said(capsys, "benchmark", "--workers", "x" * 10_000)) < 200
