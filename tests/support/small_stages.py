"""Small stages: what is tested is what happens around them. Each computation leaves a line in `$DCAP_DATA/computed`."""

import logging
import os
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np
from pydantic import BaseModel

from dcap.scene.errors import GeometryError
from dcap.scene.settings import data_root
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.outcome import Infeasible, Reason
from dcap.scene.types.pictures import Overview
from dcap.scene.types.settled import SettledBody
from tasks.artifact import Ref
from tasks.cache import stage
from tasks.run_context import Event, RunContext, StageEvent, use_context


class MakeConfig(BaseModel, frozen=True, extra="forbid"):
    """Settings: one that decides, one that does not."""

    size: float = 1.0
    threads: int = 0


def note(name: str) -> int:
    """Count a computation; returns how many of this name there are."""
    path = data_root() / "computed"
    path.parent.mkdir(parents=True, exist_ok=True)
    with path.open("a") as file:
        file.write(f"{name}\n")
    return path.read_text().split().count(name)


def make(seed: int, config: MakeConfig) -> Mesh:
    note("make")
    return Mesh.of(np.random.default_rng(seed).random((60, 3)) * config.size, [[0, 1, 2]])


def double(mesh: Mesh, factor: float = 2.0) -> Mesh:
    note("double")
    return mesh.transformed(np.diag([factor, factor, factor, 1.0]))


def rest(mesh: Mesh) -> SettledBody:
    note("rest")
    return SettledBody("object", mesh, np.zeros(3), np.array([1.0, 0, 0, 0]), 0.5 * mesh.vertices)


def paint(body: SettledBody) -> Overview:
    note("paint")
    return Overview((255 * np.resize(body.surface.vertices, (12, 9, 3)) % 255).astype(np.uint8), None)


def refuse(mesh: Mesh) -> Mesh | Infeasible:
    note("refuse")
    return Infeasible(Reason.NO_SUPPORT_HIT, "the ray met nothing", None)


def slow(seed: int) -> Mesh:
    note("slow")
    time.sleep(0.5)
    return Mesh.of(np.full((3, 3), seed), [[0, 1, 2]])


def apart(mesh: Mesh) -> Mesh:
    note("apart")
    sys.stdout.write("noise on standard output\n")
    logging.getLogger("dcap.geometry.apart").info("half way", extra={"progress": 0.5})
    return mesh


def fail(mesh: Mesh) -> Mesh:
    note("fail")
    raise GeometryError("mesh has 60 vertices > 10; lower the knob")


def die(mesh: Mesh, times: int) -> Mesh:
    if note("die") <= times:
        sys.stderr.write("last words\n")
        sys.stderr.flush()
        os.abort()
    return mesh


make_task, double_task, rest_task, paint_task = stage(make), stage(double), stage(rest), stage(paint)
refuse_task, slow_task = stage(refuse), stage(slow)
apart_task, fail_task, die_task = (stage(one, process=True) for one in (apart, fail, die))


def computed() -> list[str]:
    """What was computed since the last call, in order."""
    path = data_root() / "computed"
    names = path.read_text().split() if path.exists() else []
    path.unlink(missing_ok=True)
    return names


def chain(seed: int = 0, size: float = 1.0) -> list[Ref[Any]]:
    """Four stages, one after the other; all that they return."""
    mesh = make_task(seed, config=MakeConfig(size=size))
    large = double_task(mesh)
    body = rest_task(large)
    return [mesh, large, body, paint_task(body)]


CHAIN = ["make", "double", "rest", "paint"]
"""The names of its stages."""


def ends_of(work: Any, **context: Any) -> tuple[Any, dict[str, Event]]:
    """Run some stages; what they return, and how each has ended."""
    ends: dict[str, Event] = {}

    def on_event(event: StageEvent) -> None:
        if event.event in (Event.FINISHED, Event.CACHED, Event.MISSING):
            ends[event.stage] = event.event

    with use_context(RunContext(on_event=on_event, **context)):
        return work(), ends


def record_of(ref: Ref[Any]) -> Path:
    """The file of the record by which a stage has returned an artifact."""
    from tasks.records import records_root

    assert ref.record is not None
    return records_root() / ref.record.key
