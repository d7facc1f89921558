"""What a worker says is shown, but for what it says of a server that is away."""

import os
from pathlib import Path
from types import SimpleNamespace

import pytest
from patience import wait_until

from flows.worker import LONGEST_LOG, WorkerWords


class Worker:
    """A worker that says what it is told to say."""

    def __init__(self, log: Path) -> None:
        said, self._write = os.pipe()
        self.words = WorkerWords(SimpleNamespace(stdout=os.fdopen(said, "rb")), log)  # type: ignore[arg-type]

    def say(self, line: str) -> None:
        """A line."""
        os.write(self._write, f"{line}\n".encode())

    def end(self) -> str:
        """It ends; where its last words are."""
        os.close(self._write)
        return self.words.end()


def test_words_of_a_server_that_is_away_are_kept_and_not_shown(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Once it answers, all is shown again."""
    log, shown = tmp_path / "cache" / "worker.log", list[str]()
    worker = Worker(log)

    def shows(line: str) -> bool:
        shown.extend(capsys.readouterr().err.splitlines())
        return line in shown

    worker.say("begun")
    wait_until(lambda: shows("begun"), 30.0)
    worker.words.server_is(False)
    worker.say("a traceback")
    wait_until(lambda: log.is_file() and log.read_text() == "a traceback\n", 30.0)
    worker.words.server_is(True)
    worker.say("works on")
    wait_until(lambda: shows("works on"), 30.0)
    assert worker.end() == "stands above"
    away = f"the Prefect server does not answer; it is waited for, what Prefect says of it is in {log}"
    assert shown == ["begun", away, "the Prefect server answers again", "works on"]


def test_a_log_that_is_long_begins_anew(tmp_path: Path) -> None:
    """A server may be away for weeks; and who asks for the last words is sent there."""
    log = tmp_path / "worker.log"
    worker = Worker(log)
    worker.words.server_is(False)
    log.write_bytes(b"x" * (LONGEST_LOG + 1))
    worker.say("the last words")
    assert worker.end() == f"is in {log}"
    assert log.read_text() == "the last words\n"


def test_a_log_that_cannot_be_written_is_no_reason_to_end(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """What would be in it is shown."""
    (tmp_path / "file").touch()
    worker = Worker(tmp_path / "file" / "worker.log")
    worker.words.server_is(False)
    worker.say("a traceback")
    assert worker.end() == "stands above"
    assert capsys.readouterr().err.endswith("a traceback\n")
