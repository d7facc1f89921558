"""From a command to the step that computes, a reader follows few calls of ours: counted where they run."""

import io
import json
import os
import signal
import sys
import traceback
from pathlib import Path
from typing import NoReturn

import numpy as np
import pytest

from dcap.geometry.distance import distance_grid
from dcap.geometry.primitives import Box
from dcap.packages import COMPANIONS
from dcap.scene.errors import GeometryError
from dcap.scene.settings import PROJECT_ROOT
from dcap.scene.store.artifacts import Store
from dcap.scene.types.anchor import Anchor
from dcap.scene.types.intent import Intent, OrientationRequest, RegionRequest
from dcap.scene.types.materials import ContactFriction
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.particles import InertialProperties, Particles, RigidSimulationBody
from flows.cli import app
from solver.tl.step import Stepper
from tasks.drop.stage import DropConfig
from tasks.runner import child
from tasks.runner import stage as stage_module
from tasks.runner.stage import Stage

TO_THE_PROCESS = 7
"""Own frames from the command to the function that starts a stage's process, both counted: between them are the
sample, the flow, the stage and the body that Prefect calls."""
TO_THE_STEP = 6
"""Own frames from the first function of that process to the Newton step: stage, solver, path to rest, step length."""
SQUARE = np.array([[-0.1, -0.1], [0.1, -0.1], [0.1, 0.1], [-0.1, 0.1]])
ANCHOR = Anchor("table", "top", 0, "center", np.zeros(2), np.zeros(3), np.eye(4), 0.01, SQUARE, "test")
REGION, ORIENTATION = RegionRequest("", ("center",), (), ""), OrientationRequest("any", "", "")
INTENT = Intent("table", "table", "test", np.full(3, 0.1), 1.0, False, 1.0, ORIENTATION, REGION, (), ())


class Depth:
    """Stands in for the last function: notes who called it, and ends the work."""

    def __init__(self) -> None:
        self.callers: list[str] = []
        """Own functions on the stack, outermost first."""

    def __call__(self, *_: object, **__: object) -> NoReturn:
        self.callers = [one.name for one in traceback.extract_stack() if is_own(one.filename)]
        raise GeometryError("far enough")


def is_own(filename: str) -> bool:
    """Whether a frame belongs to the packages of the program."""
    return any(Path(filename).is_relative_to(PROJECT_ROOT / package) for package in ("dcap", *COMPANIONS))


@pytest.fixture
def depth(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Depth:
    """A stand-in, and a data folder of the test's own."""
    monkeypatch.setenv("DCAP_DATA", str(tmp_path / "data"))
    return Depth()


@pytest.mark.slow
@pytest.mark.long
def test_a_command_reaches_the_start_of_a_process_in_few_calls(
    depth: Depth, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """From `dcap place` to the function that starts a stage's process there are at most seven functions of ours."""
    box = Box(np.array([0.4, 0.4, 0.02])).surface(0.4)
    lines = [f"v {x} {y} {z}" for x, y, z in box.vertices] + [f"f {a} {b} {c}" for a, b, c in box.faces + 1]
    path = tmp_path / "board.obj"
    path.write_text("\n".join(lines) + "\n")
    monkeypatch.delenv("PREFECT_API_URL", raising=False)
    monkeypatch.setattr(Stage, "_needs_process", lambda *_: True)  # the first stage is as deep as any
    monkeypatch.setattr(stage_module, "run_in_process", depth)
    monkeypatch.setattr(signal, "signal", lambda *_: None)
    options = ["--out", str(tmp_path / "out"), "--up", "z", "--unit", "m", "--object-up", "z", "--object-unit", "m"]
    monkeypatch.setattr(sys, "argv", ["dcap", "place", str(path), str(path), "put the board on the board", *options])
    assert app.main() == GeometryError.exit_code
    reached = [*depth.callers, "run_in_process"]
    assert reached[0] == "main"
    assert "place_files" in reached
    assert len(reached) <= TO_THE_PROCESS, " ".join(reached)


@pytest.mark.slow
def test_a_process_reaches_the_newton_step_in_few_calls(depth: Depth, monkeypatch: pytest.MonkeyPatch) -> None:
    """From a stage's process to the Newton step of the drop there are at most six functions of ours."""
    store = Store.default()
    particles = Particles((board("object", 0.015, fixed=False), board("table", -0.01, fixed=True)), (), 0.01, ())
    values = {"particles": particles, "anchor": ANCHOR, "intent": INTENT}
    inputs: dict[str, object] = {name: {"ref": store.save(value).to_json()} for name, value in values.items()}
    job = {
        "module": "tasks.drop.stage",
        "function": "drop",
        "inputs": inputs | {"seed": {"value": 0}},
        "config": DropConfig(threads=2).model_dump(mode="json"),
        "session": {},
    }
    report = io.StringIO()
    monkeypatch.setattr(Stepper, "step", depth)
    monkeypatch.setattr(sys, "argv", ["child", str(os.getppid())])
    monkeypatch.setattr(sys, "stdin", io.StringIO(json.dumps(job)))
    monkeypatch.setattr(child, "die_with_parent", lambda _: None)  # the process is that of the tests
    monkeypatch.setattr(child, "forward_log", lambda _: None)
    monkeypatch.setattr(child, "private_stdout", lambda: report)
    child.main()
    assert json.loads(report.getvalue()) == {"error": {"type": "GeometryError", "message": "far enough"}}
    reached = [*depth.callers, "step"]
    assert reached[0] == "main"
    assert "settle" in reached
    assert len(reached) <= TO_THE_STEP, reached


def board(name: str, height: float, *, fixed: bool) -> RigidSimulationBody:
    """A board of 1 kg whose middle is at `height` [m]."""
    solid, center = Box(np.array([0.2, 0.2, 0.02])), np.array([0.0, 0.0, height])
    surface = solid.surface(0.02)
    mesh = Mesh.of(surface.vertices + center, surface.faces)
    low, high = mesh.bounds
    return RigidSimulationBody(
        name=name, instance=name, fixed=fixed, surface=mesh,
        distance=distance_grid(mesh, low - 0.01, high + 0.01, 0.01),
        inertial=InertialProperties(1.0, center, np.diag(solid.inertia_per_mass)),
        friction=ContactFriction(0.6, 0.5, 1e-3),
    )  # fmt: skip
