"""What `import dcap` offers: small, documented, typed, silent."""

import asyncio
import io
import json
import os
import re
import subprocess
import sys
from dataclasses import fields
from pathlib import Path

import pytest
from foreign_names import OURS, foreign_folder, marks

import dcap
from dcap.packages import COMPANIONS, ROOT
from dcap.quiet_imports import NO_VIEWER, quiet_imports
from dcap.scene.errors import DcapError
from flows.results import NamedValues, Placement, Result

HEAVY = (
    "open3d",
    "taichi",
    "prefect",
    "anthropic",
    "pyarrow",
    "numpy",
    "scipy",
    "pydantic",
    "trimesh",
    "typer",
    "rich",
)
TABLE = re.compile(r"^\| (`.*?`) \| ", re.MULTILINE)
NAME = re.compile(r"`(\w+)[^`]*`")
BOX = {"box": {"size": [0.1, 0.1, 0.1]}}
FLOOR = {"name": "floor", "shape": {"box": {"size": [0.5, 0.5, 0.1]}}, "position": [0, 0, -0.05], "motion": "fixed"}
CASE = {
    "bodies": [
        FLOOR | {"material": "concrete"},
        {"name": "cube", "shape": BOX, "position": [0, 0, 0.051], "material": "wood_oak"},
    ]
}  # fmt: skip


def test_the_names_are_the_documented_ones() -> None:
    """`dcap.__all__` and the table of docs/python.md say the same, and every name is there."""
    rows = TABLE.findall((ROOT / "docs" / "python.md").read_text())
    documented = {name for row in rows for name in NAME.findall(row)}
    assert documented == set(dcap.__all__)
    for name in dcap.__all__:
        assert getattr(dcap, name) is not None
    assert set(dcap.__all__) <= set(dir(dcap))
    assert {name for names in dcap.HOMES.values() for name in names} == documented - {"__version__"}


def test_importing_is_light() -> None:
    """`import dcap` loads no library."""
    program = f"import sys, dcap; print([name for name in {HEAVY!r} if name in sys.modules])"
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    done = subprocess.run([sys.executable, "-c", program], env=environment, capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"


@pytest.mark.parametrize(
    ("arguments", "options", "words"),
    [
        (("a", "b", "put it"), {"resolutoin": 0.01}, "unknown option 'resolutoin'; did you mean 'resolution'?"),
        (("a", "b", "put it"), {"mass": -1.0}, "--mass -1.0 is not a positive number"),
        (("a", "b", " "), {}, "PROMPT is empty"),
        (("a", "b", "put it"), {"object_up": "x"}, "--object-up 'x' is not one of"),
    ],
)
def test_place_refuses(arguments: tuple[str, str, str], options: dict[str, object], words: str) -> None:
    """What cannot be right is an InputError that names it, before anything is read."""
    with pytest.raises(dcap.InputError, match=re.escape(words)):
        dcap.place(*arguments, **options)  # type: ignore[arg-type]


def test_drop_refuses(tmp_path: Path) -> None:
    """A missing case, an option of `place` and a wrong key are InputErrors; nothing is left behind."""
    out = tmp_path / "out"
    with pytest.raises(dcap.InputError, match="no such file"):
        dcap.drop(tmp_path / "none.yaml", out=out)
    with pytest.raises(dcap.InputError, match="unknown option 'label'"):
        dcap.drop(CASE, out=out, label="table")
    with pytest.raises(dcap.InputError, match=r"case: bodies\.0\.nmae: unknown key; did you mean 'name'"):
        dcap.drop({"bodies": [{"nmae": "a"}]}, out=out)
    assert not out.exists()
    assert issubclass(dcap.InputError, DcapError)


def test_named_values() -> None:
    """Keys are attributes at any depth; nothing can be changed; an unknown one names what there is."""
    named: NamedValues[object] = NamedValues({"signals": {"speed": {"value": 1.0}}, "rows": [{"a": 1}]})
    assert named.signals.speed.value == 1.0  # type: ignore[attr-defined]
    assert named["rows"][0].a == 1  # type: ignore[index]
    assert "signals" in dir(named)
    with pytest.raises(AttributeError, match="there is signals, rows"):
        _ = named.other
    with pytest.raises(AttributeError):
        named.signals = 1  # type: ignore[attr-defined]
    assert named == {"signals": {"speed": {"value": 1.0}}, "rows": ({"a": 1},)}


NOTEBOOK = """
import io, sys
class ZMQInteractiveShell: pass
import builtins
builtins.get_ipython = ZMQInteractiveShell
sys.stdout = io.StringIO()  # as a notebook replaces it
import dcap
dcap.settle
with __import__("dcap.quiet_imports").quiet_imports.quiet_imports():
    import open3d
from taichi.lang.shell import pybuf_enabled
assert not pybuf_enabled
assert sys.stdout.getvalue() == ""
"""


def test_a_notebook_gets_its_output_back(monkeypatch: pytest.MonkeyPatch) -> None:
    """Whichever of two threads ends first."""
    mine = io.StringIO()
    monkeypatch.setattr(sys, "stdout", mine)
    monkeypatch.delenv(NO_VIEWER, raising=False)
    first, second = quiet_imports(), quiet_imports()
    first.__enter__()
    second.__enter__()
    first.__exit__(None, None, None)
    between: object = sys.stdout
    second.__exit__(None, None, None)
    after: object = sys.stdout
    assert (between, after) == (sys.__stdout__, mine)
    assert NO_VIEWER not in os.environ


@pytest.mark.slow
def test_libraries_are_silent_in_a_notebook() -> None:
    """What Taichi and Open3D say when they are imported in a notebook is not said."""
    environment = os.environ | {"PYTHONPATH": str(ROOT)}
    done = subprocess.run([sys.executable, "-c", NOTEBOOK], env=environment, capture_output=True, text=True)
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")


@pytest.mark.slow
def test_a_drop_from_a_dict(tmp_path: Path, capfd: pytest.CaptureFixture[str]) -> None:
    """A dict settles as a file does; the result has every key of result.json as an attribute; nothing is printed."""
    result = dcap.drop(CASE, out=tmp_path, resolution=0.02, threads=1)
    assert capfd.readouterr() == ("", "")
    tree = json.loads((tmp_path / "result.json").read_text())
    assert set(tree) == {field.name for field in fields(Result)} - {"folder", "tree"}
    assert result.verdict == "at_rest"
    assert list(result.bodies.cube.position) == tree["bodies"]["cube"]["position"]  # type: ignore[union-attr]
    assert result.contacts[0].area_m2 == tree["contacts"][0]["area_m2"]
    assert set(tree["contacts"][0]) <= {field.name for field in fields(type(result.contacts[0]))}
    assert result.certificate is not None
    assert result.certificate.arch == "cpu"
    assert all(path.is_file() for path in result.artifacts.values())
    assert json.loads(result.to_json()) == tree == json.loads(Result.read(tmp_path).to_json())
    assert repr(result).startswith("Result(at_rest, bodies floor, cube")


@pytest.mark.slow
@pytest.mark.long
def test_a_placement_inside_a_running_loop(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capfd: pytest.CaptureFixture[str]
) -> None:
    """As in a notebook, where a loop runs: nothing is printed, and every key of placement.json is an attribute."""
    monkeypatch.setenv("DCAP_DATA", str(tmp_path / "data"))
    monkeypatch.delenv("PREFECT_API_URL", raising=False)
    monkeypatch.setenv("PREFECT_HOME", str(tmp_path))
    for name, high in (("table", (1.0, 1.0, 0.7)), ("cube", (0.1, 0.1, 0.1))):
        (tmp_path / f"{name}.obj").write_text(box_obj(*high))

    async def cell() -> Placement:
        return dcap.place(tmp_path / "table.obj", tmp_path / "cube.obj", "put the cube on the table", label="table",
                          up="z", unit="m", object_up="z", object_unit="m", threads=1)  # fmt: skip

    placement = asyncio.run(cell())
    assert capfd.readouterr() == ("", "")
    tree = json.loads((placement.folder / "placement.json").read_text())
    assert set(tree) == {field.name for field in fields(Placement)} - {"folder", "tree", "checks", "evidence"}
    assert placement.verdict == "at_rest", placement.to_json()
    assert placement.certificate is not None
    assert placement.certificate.signals.force_residual.holds
    assert placement.checks is not None
    assert placement.checks.carried_share.value == tree["certificate"]["placement"]["carried_share"]["value"] == 1.0
    assert not placement.evidence
    assert placement.pose is not None
    assert list(placement.pose.position) == tree["pose"]["position"]
    for key in ("contacts", "materials", "geometry"):
        assert set(tree[key][0]) <= {field.name for field in fields(getattr(placement, key)[0])}
    assert placement.artifacts.closeup.is_file()
    assert placement.folder.parent == tmp_path / "data" / "runs" / "python"
    assert repr(placement).startswith("Placement(at_rest on table")


def box_obj(x: float, y: float, z: float) -> str:
    """A closed box on the floor."""
    corners = "".join(f"v {a} {b} {c}\n" for a in (0, x) for b in (0, y) for c in (0, z))
    return corners + "f 1 2 4 3\nf 5 7 8 6\nf 1 5 6 2\nf 3 4 8 7\nf 1 3 7 5\nf 2 6 8 4\n"


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
