"""What tests of processes share."""

import os
from pathlib import Path

import pytest
from process_jobs import JOBS, ROOT

from tasks.runner.process_server import START_METHOD


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A data folder, with the fake stages on the path of processes."""
    (tmp_path / "fake_jobs.py").write_text(JOBS)
    monkeypatch.setenv("DCAP_DATA", str(tmp_path))
    monkeypatch.setenv("PYTHONPATH", os.pathsep.join([str(ROOT), str(tmp_path)]))
    monkeypatch.delenv(START_METHOD, raising=False)
    return tmp_path
