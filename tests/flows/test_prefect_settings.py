"""What Prefect is set to: nothing of the folder that a program was started in."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from foreign_names import LIBRARIES, OURS, SETTINGS, foreign_folder, marks

from dcap.scene.settings import PROJECT_ROOT

APPLY = "from flows.prefect_settings import apply_settings; apply_settings(); "
FLOW = "from prefect import Flow; from prefect.settings import get_current_settings; "
TELL = "one = get_current_settings(); print(one.client.max_retries, one.server.analytics_enabled)"


def told(folder: Path, program: str, **environment: str) -> "subprocess.CompletedProcess[str]":
    """What a program says that runs in a folder and finds our packages there."""
    (folder / "data" / "cache" / "prefect").mkdir(parents=True, exist_ok=True)
    kept = {name: value for name, value in os.environ.items() if not name.startswith("PREFECT_")}
    return subprocess.run(
        [sys.executable, "-P", "-c", program], cwd=folder, capture_output=True, text=True,
        env=kept | {"PYTHONPATH": str(PROJECT_ROOT), "DCAP_DATA": str(folder / "data")} | environment,
    )  # fmt: skip


def test_files_of_the_working_directory_set_nothing(tmp_path: Path) -> None:
    """They may come with a data set, and name code to run; or be somebody's own, and be damaged."""
    foreign_folder(tmp_path, OURS + LIBRARIES)
    assert told(tmp_path, FLOW + TELL).returncode == 0
    assert marks(tmp_path)  # so it is where Prefect is left to itself
    (tmp_path / "mark").unlink()
    done = told(tmp_path, APPLY + FLOW + TELL)
    assert done.stdout == "5 False\n", done.stderr
    assert done.stderr == ""
    for name in SETTINGS:
        (tmp_path / name).write_text("[client\nmax_retries = 77\n")
    (tmp_path / ".env").write_text("PREFECT_CLIENT_MAX_RETRIES=77\nPREFECT_PROFILES_PATH=/nowhere\n")
    done = told(tmp_path, APPLY + FLOW + TELL)
    assert (done.stdout, done.stderr) == ("5 False\n", "")
    assert marks(tmp_path) == ""


@pytest.mark.parametrize("name", SETTINGS)
def test_processes_of_others_run_no_file_that_is_named_there(tmp_path: Path, name: str) -> None:
    """Those of a cluster import Prefect before anything of ours; they have our environment."""
    foreign_folder(tmp_path, ())
    for other in SETTINGS.keys() - {name}:
        (tmp_path / other).unlink()
    start = (
        "import subprocess, sys; subprocess.run([sys.executable, '-P', '-c', 'from prefect import Flow'], check=True)"
    )
    assert told(tmp_path, start, PREFECT_HOME=str(tmp_path / "home")).returncode == 0
    assert marks(tmp_path)  # so it is where nothing is set
    (tmp_path / "mark").unlink()
    done = told(tmp_path, APPLY + start)
    assert (done.returncode, done.stderr) == (0, "")
    assert marks(tmp_path) == ""


def test_no_file_of_the_data_folder_is_run(tmp_path: Path) -> None:
    """A `dcap.yaml` of the working directory may choose that folder."""
    home = tmp_path / "data" / "cache" / "prefect"
    home.mkdir(parents=True)
    foreign_folder(home, ())
    done = told(tmp_path, APPLY + FLOW + TELL)
    assert (done.stdout, done.stderr) == ("5 False\n", "")
    assert marks(home) == ""


def test_the_environment_wins(tmp_path: Path) -> None:
    """What a person sets is not replaced."""
    done = told(tmp_path, APPLY + FLOW + TELL, PREFECT_CLIENT_MAX_RETRIES="2", PREFECT_SERVER_ANALYTICS_ENABLED="true")
    assert done.stdout == "2 True\n"
    own = told(
        tmp_path, APPLY + "import os; print(os.environ.get('PREFECT_LOGGING_CONFIG_PATH'))",
        PREFECT_LOGGING_SETTINGS_PATH="/mine.yml",
    )  # fmt: skip
    assert own.stdout == "None\n"
