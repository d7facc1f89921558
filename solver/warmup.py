"""Loads or compiles every kernel that a model needs before the clock starts, by a drop of a few cells for two steps."""

from contextlib import suppress
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from solver.config import SolverConfig
from solver.errors import UnstableStep
from solver.model.bodies import Body, Interior, Model, RigidBody, SignedDistance, SoftBody
from solver.model.grid import graded_planes
from solver.settle import settle

SIDE = 0.1  # side of each cube [m]
OVERLAP = 1e-4  # they touch from the start [m]


def warm_up(model: Model, config: SolverConfig) -> None:
    """Drop a small stack with the kinds of bodies of `model`; its result does not matter."""
    with suppress(UnstableStep):
        drop_little(config, soft=bool(model.soft_bodies))


def drop_little(config: SolverConfig, *, soft: bool) -> None:
    """Drop a stack of three cubes, the middle one `soft` or rigid, for two steps; raises the errors of `settle`."""
    floor = replace(_cube("floor", SIDE, None), fixed=True)
    middle = _cube("middle", 2.0 * SIDE - OVERLAP, _interior(2.0 * SIDE - OVERLAP) if soft else None)
    lid = _cube("lid", 3.0 * SIDE - 2.0 * OVERLAP, None)
    stack = Model((floor, middle, lid), np.array([0.0, 0.0, -9.81]))
    settle(stack, config.model_copy(update={"step_limit": 2, "rest_steps": 2}))


def _corners(top: float) -> NDArray[np.float64]:
    low = np.array([0.0, 0.0, top - SIDE])
    return low + SIDE * np.array(list(np.ndindex(2, 2, 2)), dtype=np.float64)


def _cube(name: str, top: float, interior: Interior | None) -> Body:
    vertices = _corners(top)
    faces = np.array(
        [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
         [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]], dtype=np.int32
    )  # fmt: skip
    center = vertices.mean(axis=0)
    axes = [np.linspace(c - SIDE, c + SIDE, 5) for c in center]
    points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
    distance = np.abs(points - center).max(axis=-1) - 0.5 * SIDE
    grid = SignedDistance(np.array([a[0] for a in axes]), 0.5 * SIDE, distance.astype(np.float32))
    common = (name, False, vertices, faces, grid, 0.1, center, 0.5, 0.4, 1e-3)
    return RigidBody(*common, 1e-4 * np.eye(3)) if interior is None else SoftBody(*common, interior)


def _interior(top: float) -> Interior:
    low = _corners(top)[0]
    x, y, z = (graded_planes(a, a + SIDE, a, a + SIDE, 0.5 * SIDE) for a in low)
    middle = [0.5 * (p[:-1] + p[1:]) for p in (x, y, z)]
    points = np.stack(np.meshgrid(*middle, indexing="ij"), axis=-1).reshape(-1, 3)
    one = np.ones(len(points))
    held = np.zeros((len(x), len(y), len(z)), dtype=np.int8)
    return Interior(
        points, one * SIDE**3 / len(points), 100.0 * one, 1e5 * one, 0.3 * one, (x, y, z), held, loaded=False
    )
