"""Our packages are found beside dcap, whatever the working directory holds."""

import os
import subprocess
import sys
from pathlib import Path

from foreign_names import OURS, foreign_folder, marks

from dcap.packages import COMPANIONS, ROOT

FILES = f"""
import dcap, {", ".join(f"{name}" for name in COMPANIONS)}, tasks.records, solver.errors, flows.options
print(*({", ".join(f"{name}.__file__" for name in COMPANIONS)}))
"""


def python(folder: Path, program: str) -> "subprocess.CompletedProcess[str]":
    """Run a program as a notebook does: its folder leads sys.path."""
    return subprocess.run(
        [sys.executable, "-c", program], cwd=folder, env=os.environ | {"PYTHONPATH": str(ROOT)}, capture_output=True,
        text=True,
    )  # fmt: skip


def test_the_working_directory_does_not_win_in_a_notebook(tmp_path: Path) -> None:
    """`import dcap` finds its own flows, tasks and solver where files of these names lead sys.path."""
    done = python(foreign_folder(tmp_path, OURS), FILES)
    assert done.returncode == 0, done.stderr
    assert done.stdout.split() == [str(ROOT / name / "__init__.py") for name in COMPANIONS]
    assert marks(tmp_path) == ""


def test_a_foreign_package_that_is_imported_already(tmp_path: Path) -> None:
    """One clear ImportError names the package and the foreign file."""
    (tmp_path / "tasks.py").write_text("mine = True\n")
    done = python(tmp_path, "import tasks; import dcap")
    last = done.stderr.strip().splitlines()[-1]
    assert done.returncode == 1
    assert last.startswith("ImportError: dcap has a package 'tasks' of its own")
    assert str(tmp_path / "tasks.py") in last
