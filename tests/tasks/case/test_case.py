"""Case files: what is accepted, what is refused and how, and what is written."""

import hashlib
import json
import os
import subprocess
import sys
import textwrap
from pathlib import Path

import pytest

from dcap.scene.errors import InputError
from solver.errors import UnstableStep
from tasks.case.bodies import case_particles
from tasks.case.file import Case, CaseMaterial, read_case
from tasks.case.run import run_case, write_case

CUBE = """
bodies:
  - name: floor
    shape: {box: {size: [0.4, 0.4, 0.05]}}
    position: [0, 0, -0.025]
    motion: fixed
    material: steel
  - name: cube
    shape: {box: {size: [0.1, 0.1, 0.1]}}
    position: [0, 0, 0.06]
    mass: 1.0
    material: {density: 700, youngs_modulus: 1.0e10, poisson_ratio: 0.3, static_friction: 0.5, dynamic_friction: 0.4}
"""


@pytest.fixture
def case_file(tmp_path):
    def write(text):
        path = tmp_path / "case.yaml"
        path.write_text(text)
        return path

    return write


MISTAKES = [
    ("mass: 1.0", "mas: 1.0", "did you mean 'mass'"),
    ("box:", "boxx:", "did you mean 'box'"),
    ("mass: 1.0", "mass: true", "bodies.1.mass: true and false are not numbers"),
    ("mass: 1.0", "mass: -1.0", "greater than 0"),
    ("poisson_ratio: 0.3", "poisson_ratio: 0.5", "less than 0.5"),
    (
        "poisson_ratio: 0.3",
        "poisson_ratio: 0.3, layers: {youngs_modulus: 1.0e11, poisson_ratio: 0.2, shear_modulus: 1.0e9}",
        "Poisson ratio across the layers is 0.3, must be below 0.2",
    ),
    ("1.0e10", ".nan", "finite"),
    ("material: steel", "material: steal", "did you mean 'steel'"),
    ("name: cube", "name: floor", "must differ"),
    ("{box: {size: [0.1, 0.1, 0.1]}}", "{box: {size: [0.1, 0.1, 0.1]}, sphere: {radius: 1}}", "exactly one"),
    ("bodies:", "inertia: maybe\nbodies:", "inertia"),
    ("bodies:", "bonds: [[cube, flor]]\nbodies:", "bond names body 'flor'"),
    ("mass: 1.0", "quaternion: [0, 0, 0, 0]", "length 0 instead of 1"),
    ("material: steel", "material: steal", "case.yaml"),
    ("{box: {size: [0.1, 0.1, 0.1]}}", "{mesh: none.ply}", "bodies.cube.shape.mesh"),
    (CUBE, "", "holds no keys"),
    ("bodies:", "seed: -1\nbodies:", "greater than or equal to 0"),
    ("bodies:", "gravity: [0, 0, 0]\nbodies:", "give a resolution"),
]
"""A text of the case, what stands there instead, and words that are said of it."""


def test_bad_input_is_refused_in_one_line_that_names_key_and_value(case_file, tmp_path, subtests: pytest.Subtests):
    """One InputError, one line, and nothing is written."""
    for number, (old, new, words) in enumerate(MISTAKES):
        with subtests.test(str((old, new))):
            path, out = case_file(CUBE.replace(old, new, 1)), tmp_path / f"out_{number}"
            with pytest.raises(InputError) as caught:
                run_case(path, out, quiet=True)
            assert words in str(caught.value)
            assert "\n" not in str(caught.value)
            assert not out.exists()


def test_a_number_in_scientific_notation_is_a_number(case_file):
    """YAML 1.2: 1.0e10 is a float, not a string."""
    material = read_case(case_file(CUBE)).bodies[1].material
    assert isinstance(material, CaseMaterial)
    assert material.youngs_modulus == 1e10


def test_a_fixed_soft_body_needs_a_clamp(case_file):
    """With `clamp: none` it would fall."""
    text = CUBE.replace("material: steel", "clamp: none\n    model: mpm\n    material: steel", 1)
    with pytest.raises(InputError, match="clamp"):
        read_case(case_file(text))


@pytest.mark.slow
def test_bodies_that_start_inside_each_other_are_refused(case_file, tmp_path):
    """Deep overlap has no honest rest state."""
    with pytest.raises(InputError, match="inside each other"):
        run_case(case_file(CUBE.replace("0.06]", "0.03]")), tmp_path / "out", quiet=True)


def test_a_case_writes_result_bodies_and_history(case_file, tmp_path):
    """The contract's keys are there and the cube lies on the floor with its weight carried (0.5 %)."""
    summary = run_case(case_file(CUBE), tmp_path / "out", quiet=True)
    written = json.loads((tmp_path / "out" / "result.json").read_text())
    assert written == json.loads(json.dumps(summary))
    assert written["verdict"] == "at_rest"
    assert written["certificate"]["arch"] == "cpu"
    # penetration target 0.05 mm
    assert written["bodies"]["cube"]["position"][2] == pytest.approx(0.05, abs=1e-4)
    assert written["contacts"][0]["normal_force_n"] == pytest.approx(9.81, rel=5e-3)
    assert {p.name for p in (tmp_path / "out").iterdir()} == {"result.json", "history.parquet", "floor.ply", "cube.ply"}


@pytest.mark.slow
@pytest.mark.long
def test_an_earlier_result_is_replaced_and_other_files_stay(case_file, tmp_path, monkeypatch):
    """`--out` may be a folder with other things in it, and a drop that breaks leaves no earlier verdict behind."""
    out = tmp_path / "out"
    run_case(case_file(CUBE), out, quiet=True)
    (out / "notes.txt").write_text("mine")
    run_case(case_file(CUBE.replace("name: cube", "name: block")), out, quiet=True)
    assert {p.name for p in out.iterdir()} == {
        "result.json", "history.parquet", "floor.ply", "block.ply", "notes.txt"
    }  # fmt: skip

    def broken(*_):
        raise UnstableStep("t = 0.1 s: step ends with 7 of the free weight unbalanced")

    monkeypatch.setattr("tasks.case.run.settle", broken)
    result = run_case(case_file(CUBE), out, quiet=True)
    assert result["verdict"] == "unstable_step"
    assert json.loads((out / "result.json").read_text())["warnings"] == result["warnings"]
    assert {p.name for p in out.iterdir()} == {"result.json", "notes.txt"}


@pytest.mark.slow
def test_more_cells_than_a_person_waits_for_are_refused_before_anything_is_built(case_file, tmp_path):
    """A slip in --resolution costs no memory."""
    soft = CUBE.replace("youngs_modulus: 1.0e10", "youngs_modulus: 1.0e5")
    with pytest.raises(InputError, match="raise --resolution"):
        run_case(case_file(soft), tmp_path / "out", resolution=1e-4, quiet=True)


@pytest.mark.slow
def test_a_tiny_body_costs_no_more_memory_than_a_large_one(tmp_path):
    """Samples of the signed distance are counted in units of the body's size: 1 mm across as well as 10 cm."""
    counts = []
    for radius in (5e-4, 5e-2):
        shape = {
            "name": "bead",
            "shape": {"sphere": {"radius": radius}},
            "position": [0, 0, radius],
            "material": "steel",
        }
        board = {"name": "floor", "shape": {"box": {"size": [0.4, 0.4, 0.05]}}, "position": [0, 0, -0.025],
                 "motion": "fixed", "material": "steel"}  # fmt: skip
        found = case_particles(Case.model_validate({"bodies": [board, shape]}), tmp_path, None)
        counts.append(found.bodies[1].distance.values.size)
    assert max(counts) < 10_000_000


@pytest.mark.slow
@pytest.mark.long
def test_results_do_not_depend_on_the_number_of_threads(tmp_path):
    """A soft block under a ball, each in a process of its own: the same bytes but for the times."""
    path = tmp_path / "case.yaml"
    path.write_text(CUBE.replace("1.0e10", "2.0e4").replace("bodies:", "resolution: 0.02\nbodies:"))
    found = []
    for threads in (1, 2, 4):
        out = tmp_path / str(threads)
        command = [
            sys.executable,
            "-m",
            "flows.cli",
            "drop",
            str(path),
            "--out",
            str(out),
            "--threads",
            str(threads),
        ]
        subprocess.run(command, check=True, capture_output=True)
        tree = json.loads((out / "result.json").read_text())
        found.append({k: v for k, v in tree.items() if k not in ("wall_s", "timings")})
        found[-1]["ply"] = (out / "cube.ply").read_bytes()
    assert found[0] == found[1] == found[2]


def test_a_result_with_nan_is_not_written(tmp_path):
    """It is a mistake of ours; a file with NaN in it is no JSON."""
    with pytest.raises(ValueError, match="not JSON compliant"):
        write_case(tmp_path, {"contacts": [{"area_m2": float("nan")}]}, (), None)
    assert not list(tmp_path.iterdir())


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
