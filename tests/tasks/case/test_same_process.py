"""What a process did before changes nothing of what it does next."""

import hashlib
import os
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[3]

PROGRAM = """
import hashlib, sys
from pathlib import Path
from tasks.case.run import run_case

foam = {"density": 60, "youngs_modulus": 5e4, "poisson_ratio": 0.3, "static_friction": 0.6, "dynamic_friction": 0.5}
slab = {"name": "slab", "shape": {"box": {"size": [0.3, 0.3, 0.08]}}, "position": [0, 0, 0.04], "motion": "fixed",
        "material": foam}
ball = {"name": "ball", "shape": {"sphere": {"radius": 0.05}}, "position": [0.01, 0, 0.135], "mass": 1.0}
cube = {"name": "ball", "shape": {"box": {"size": [0.08, 0.08, 0.08]}}, "position": [0, 0, 0.125], "mass": 0.2}
out = Path(sys.argv[1])
for name in sys.argv[2]:
    body = {"a": {**ball, "material": "steel"}, "b": {**cube, "material": foam}}[name]
    run_case({"bodies": [slab, body], "resolution": 0.02}, out / name, quiet=True, threads=1)
"""


@pytest.mark.slow
@pytest.mark.long
def test_a_drop_is_the_same_in_a_process_that_has_done_others(tmp_path: Path) -> None:
    """The files of a steel ball on foam, dropped in a new process and after a cube of foam, have the same bytes."""
    program = tmp_path / "program.py"
    program.write_text(textwrap.dedent(PROGRAM))
    found = []
    for number, order in enumerate(("a", "ba")):
        out = tmp_path / str(number)
        subprocess.run(
            [sys.executable, str(program), str(out), order], check=True, env=os.environ | {"PYTHONPATH": str(ROOT)}
        )
        files = sorted(path for path in (out / "a").rglob("*") if path.is_file() and path.suffix != ".json")
        assert files
        found.append({path.name: hashlib.sha256(path.read_bytes()).hexdigest() for path in files})
    assert found[0] == found[1]
