"""A wheel of dcap, installed elsewhere, does what a clone does."""

import json
import os
import shutil
import subprocess
import sys
import sysconfig
import venv
from pathlib import Path

import pytest
from foreign_names import OURS, foreign_folder, marks

from dcap.packages import COMPANIONS, ROOT
from tasks.code import code_of

CASE = """
resolution: 0.02
bodies:
  - {name: floor, shape: {box: {size: [0.5, 0.5, 0.1]}}, position: [0, 0, -0.05], motion: fixed, material: concrete}
  - {name: cube, shape: {box: {size: [0.1, 0.1, 0.1]}}, position: [0, 0, 0.051], material: wood_oak}
"""
BUILT = shutil.ignore_patterns(".git", ".venv*", ".*_cache", "__pycache__", "*.egg-info", "build", "dist", "tests")
"""Of a clone: the tests, and what tools leave."""
MADE = {"cache", "runs", "replies", "rooms", "splat_rooms", "objects", "truth"}
"""Of its data: what dcap makes."""
CARRIED = ("materials.csv", "prefect.toml", "prompts/common.j2", "data/rooms.yaml", "data/recipes/objects.yaml")
SHOW = """
import dcap, json, sys
from dcap.scene.settings import PROJECT_ROOT, data_root
from tasks.code import code_of
result = dcap.drop("case.yaml", threads=1)
stage = PROJECT_ROOT / "tasks" / "materials" / "stage.py"
print(json.dumps({
    "home": str(PROJECT_ROOT), "data": str(data_root()), "version": dcap.__version__, "verdict": result.verdict,
    "folder": str(result.folder), "digests": dict(code_of(stage, PROJECT_ROOT).files),
}))
"""


DATA_FILES = {".css", ".csv", ".j2", ".js", ".yaml", ".typed"}
"""Suffixes of what lies beside the modules and is no module."""
TYPED = """
import dcap

result: dcap.Result = dcap.drop("case.yaml", resolution=0.01)
dcap.drap("case.yaml")

def settled(model: dcap.Model) -> dcap.SettledModel:
    return dcap.settle(modle=model, config=dcap.SolverConfig())
"""
MISTAKES = {5: '"drap"', 8: '"modle"'}
"""What is wrong in it, by line."""


@pytest.fixture(scope="module")
def installed(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Programs of a fresh environment with dcap's wheel; its dependencies are those of the tests' environment."""
    folder = tmp_path_factory.mktemp("installed")
    shutil.copytree(ROOT, folder / "clone", ignore=left_out, symlinks=True)
    pip = [sys.executable, "-m", "pip", "--quiet", "--disable-pip-version-check"]
    wheel = [*pip, "wheel", "--no-deps", "--no-build-isolation", "--wheel-dir", str(folder), str(folder / "clone")]
    subprocess.run(wheel, check=True, env=clean())
    venv.create(folder / "venv", with_pip=False)
    programs = folder / "venv" / "bin"
    (name,) = folder.glob("*.whl")
    subprocess.run(
        [*pip, "--python", str(programs / "python"), "install", "--no-deps", "--no-index", str(name)],
        check=True, env=clean(),
    )  # fmt: skip
    (site_of(programs) / "dependencies.pth").write_text(sysconfig.get_path("purelib") + "\n")
    shutil.rmtree(folder / "clone")
    return programs


def left_out(folder: str, names: list[str]) -> set[str]:
    """What is not copied of a folder of the clone."""
    return BUILT(folder, names) | (MADE if Path(folder) == ROOT / "data" else set())


def clean(**more: str) -> dict[str, str]:
    """The environment without what would lead to the clone."""
    return {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "DCAP_DATA")} | more


@pytest.mark.slow
@pytest.mark.long
def test_the_wheel_works_elsewhere(installed: Path, tmp_path: Path) -> None:
    """From a folder with a foreign tasks.py, solver.py and flows/, the command line and Python drop a case; data lies
    in the user's own folder, and a stage has the same digests as in a clone."""
    here = foreign_folder(tmp_path, OURS)
    (here / "case.yaml").write_text(CASE)
    environment = clean(XDG_DATA_HOME=str(tmp_path / "share"))

    def run(*command: str) -> str:
        done = subprocess.run(command, cwd=here, env=environment, capture_output=True, text=True)
        assert done.returncode == 0, done.stderr
        return done.stdout

    version = run(str(installed / "dcap"), "--version")
    assert run(str(installed / "dcap"), "drop", "case.yaml", "--out", "out").startswith("at_rest")
    shown = json.loads(run(str(installed / "python"), "-c", SHOW))
    assert version == f"dcap {shown['version']}\n"
    assert shown["verdict"] == "at_rest"
    assert Path(shown["home"]).is_relative_to(installed.parent)
    assert shown["data"] == str(tmp_path / "share" / "dcap")
    assert Path(shown["folder"]).is_relative_to(shown["data"])
    stage = ROOT / "tasks" / "materials" / "stage.py"
    assert shown["digests"] == dict(code_of(stage, ROOT).files)
    assert {"materials.csv", "prompts/common.j2"} <= set(shown["digests"])
    assert marks(tmp_path) == ""


@pytest.mark.slow
def test_the_wheel_carries_the_data(installed: Path) -> None:
    """Every file that lies at the root of a clone and is read at run time is in the wheel, byte by byte."""
    program = "from dcap.scene.settings import resource; print(resource('.'))"
    done = subprocess.run([installed / "python", "-P", "-c", program], env=clean(), capture_output=True, text=True)
    home = Path(done.stdout.strip())
    carried = {str(path.relative_to(home)) for path in home.rglob("*") if path.is_file()}
    assert set(CARRIED) <= carried
    assert carried >= {str(path.relative_to(ROOT)) for path in (ROOT / "prompts").iterdir()}
    for pattern in ("*.yaml", "recipes/**/*.yaml"):
        assert carried >= {str(path.relative_to(ROOT)) for path in (ROOT / "data").glob(pattern)}
    for name in carried:
        assert (home / name).read_bytes() == (ROOT / name).read_bytes(), name


@pytest.mark.slow
def test_the_wheel_carries_what_lies_beside_modules(installed: Path) -> None:
    """Every tracked data file of the packages is in the wheel, byte by byte: lexicon, prices, templates, markers."""
    listed = subprocess.run(["git", "ls-files", "dcap", *COMPANIONS], cwd=ROOT, capture_output=True, text=True)
    if listed.returncode:
        pytest.skip("not a clone: git lists no files")
    names = [name for name in listed.stdout.splitlines() if Path(name).suffix in DATA_FILES]
    assert {Path(name).suffix for name in names} >= {".csv", ".j2", ".typed"}
    site = site_of(installed)
    assert [name for name in names if not (site / name).is_file()] == []
    assert [name for name in names if (site / name).read_bytes() != (ROOT / name).read_bytes()] == []


@pytest.mark.long
@pytest.mark.slow
def test_the_wheel_is_typed(installed: Path, tmp_path: Path) -> None:
    """A type checker sees the face of an installed dcap: a misspelt option is an error, what is right is none."""
    (tmp_path / "program.py").write_text(TYPED)
    options = ["--config-file", "", "--cache-dir", "cache", "--python-executable", str(installed / "python")]
    done = subprocess.run(
        [sys.executable, "-m", "mypy", *options, "program.py"],
        cwd=tmp_path, env=clean(), capture_output=True, text=True,
    )  # fmt: skip
    errors = [line for line in done.stdout.splitlines() if ": error: " in line]
    assert len(errors) == len(MISTAKES), done.stdout + done.stderr
    for (number, word), line in zip(MISTAKES.items(), errors, strict=True):
        assert line.startswith(f"program.py:{number}: ")
        assert word in line


def site_of(programs: Path) -> Path:
    """Where an environment has its packages."""
    (site,) = (programs.parent / "lib").glob("python*/site-packages")
    return site
