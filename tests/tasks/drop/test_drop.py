"""Each verdict of the drop from a scene that produces it, and how outcomes are judged against what was asked."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dcap.geometry.distance import MeshDistance, sampled
from dcap.geometry.primitives import Box, Capsule, Primitive
from dcap.scene.errors import GeometryError
from dcap.scene.types.choices import Anchor, Intent, Lean, OrientationRequest, RegionRequest
from dcap.scene.types.materials import ContactFriction
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.outcome import Infeasible, Reason
from dcap.scene.types.particles import (
    GRAVITY,
    BackgroundGrid,
    ColumnLayer,
    InertialProperties,
    MaterialPoints,
    Particles,
    RigidSimulationBody,
    SoftSimulationBody,
)
from dcap.scene.types.settled import LastState, PlacementChecks, Settled
from solver.certificate import NotDone
from solver.config import SolverConfig
from solver.mls.drop import ExplicitDrop
from solver.model.bodies import Model
from solver.runtime import start
from solver.settle import settle
from tasks.bodies.solver_model import solver_model
from tasks.case.bodies import case_particles
from tasks.case.file import checked_case
from tasks.drop.stage import (
    DropConfig,
    able,
    carried_share,
    drop,
    refuse_coarse_layers,
    toppling,
    with_checks,
)


def body(
    name: str,
    solid: Primitive,
    position: list[float],
    *,
    fixed: bool,
    turn: np.ndarray | None = None,
    mass: float = 1.0,
) -> RigidSimulationBody:
    """A rigid primitive."""
    rotation = np.eye(3) if turn is None else turn
    surface = solid.surface(0.01)
    mesh = Mesh.of(surface.vertices @ rotation.T + np.array(position), surface.faces)
    low, high = mesh.bounds
    grid = sampled(MeshDistance(mesh), low - 0.01, high + 0.01, 0.003)
    inertia = rotation @ np.diag(solid.inertia_per_mass * mass) @ rotation.T
    return RigidSimulationBody(
        name=name, instance="object" if name == "object" else "table", fixed=fixed, surface=mesh, distance=grid,
        inertial=InertialProperties(mass, np.array(position), inertia), friction=ContactFriction(0.6, 0.5, 1e-3),
    )  # fmt: skip


def table(turn: np.ndarray | None = None) -> RigidSimulationBody:
    """A board whose top is z = 0."""
    return body("table/rigid", Box(np.array([0.4, 0.4, 0.02])), [0, 0, -0.01], fixed=True, turn=turn)


def asked(pose: str = "any", facing: str = "") -> Intent:
    """An intent with an orientation."""
    region = RegionRequest("", ("center",), (), "")
    orientation = OrientationRequest(pose, facing, "")
    return Intent("table", "table", "test", np.full(3, 0.1), 1.0, False, 1.0, orientation, region, (), ())


def anchor() -> Anchor:
    """On the middle of the table; the object's own upward axis is the world's."""
    pose = np.eye(4)
    square = np.array([[-0.1, -0.1], [0.1, -0.1], [0.1, 0.1], [-0.1, 0.1]])
    return Anchor("table", "top", 0, "center", np.zeros(2), np.zeros(3), pose, 0.01, square, "test")


def placement(found: Infeasible) -> PlacementChecks:
    """What was asked of the rest state."""
    assert isinstance(found.evidence, LastState)
    return found.evidence.checks


def run(item: RigidSimulationBody, base: RigidSimulationBody, intent: Intent, **solver: object) -> Settled | Infeasible:
    """Drop the object on the base."""
    particles = Particles((item, base), (), 0.01, ())
    return drop(particles, anchor(), intent, 0, DropConfig(solver=SolverConfig.model_validate(solver), threads=2))


def test_a_box_on_a_table_is_at_rest() -> None:
    """And all its weight is on the table."""
    found = run(body("object", Box(np.array([0.1, 0.1, 0.1])), [0, 0, 0.06], fixed=False), table(), asked("upright"))
    assert isinstance(found, Settled)
    assert found.verdict == "at_rest"
    assert abs(found.bodies[0].surface.bounds[0, 2]) < 3e-4


@pytest.mark.slow
def test_a_ball_on_a_slope_leaves_its_target() -> None:
    """Rolling resistance holds a slope of b / R = 2 % only."""
    turn = Rotation.from_euler("y", 15, degrees=True).as_matrix()
    found = run(body("object", Capsule(0.05, 0.0), [0, 0, 0.065], fixed=False), table(turn), asked())
    assert isinstance(found, Infeasible)
    assert found.reason is Reason.LEFT_TARGET
    assert isinstance(found.evidence, LastState)
    assert found.evidence.certificate.kick == NotDone()


@pytest.mark.slow
@pytest.mark.parametrize(("pose", "facing", "reason"), [
    ("upright", "", Reason.TOPPLED), ("any", "wall", Reason.TOPPLED), ("any", "", None),
])  # fmt: skip
def test_falling_over_counts_only_where_a_pose_or_a_facing_was_asked(
    pose: str, facing: str, reason: Reason | None
) -> None:
    """A tall box put down askew falls on its side: toppled if it was to stand or to look somewhere, else at rest."""
    turn = Rotation.from_euler("y", 25, degrees=True).as_matrix()
    box = Box(np.array([0.04, 0.04, 0.16]))
    lowest = float((np.abs(turn[2]) * box.half_extents).sum())
    found = run(body("object", box, [0, 0, lowest + 1e-3], fixed=False, turn=turn), table(), asked(pose, facing))
    if reason is None:
        assert isinstance(found, Settled)
        assert found.verdict == "at_rest"
    else:
        assert isinstance(found, Infeasible)
        assert found.reason is reason
        tilt = placement(found).tilt_rad
        assert tilt is not None
        assert tilt.value > tilt.threshold == pytest.approx(np.radians(45), rel=1e-4)


@pytest.mark.parametrize(("facing", "reason"), [("wall", Reason.TOPPLED), ("", None)])
def test_turning_away_counts_only_where_a_facing_was_asked(facing: str, reason: Reason | None) -> None:
    """A box that spins about the vertical on a slippery board ends turned by more than 45 degrees."""
    item = body("object", Box(np.array([0.1, 0.1, 0.05])), [0, 0, 0.026], fixed=False)
    found = run(replace(item, friction=ContactFriction(0.0, 0.0, 1e-3)), table(), asked("any", facing))
    assert isinstance(found, Settled)  # nothing turns it
    spun = with_checks(
        replace(found, bodies=(replace(found.bodies[0], quaternion=about_z(60.0)), *found.bodies[1:])),
        Particles((item, table()), (), 0.01, ()), anchor(), asked("any", facing), DropConfig(),
    )  # fmt: skip
    outcome = toppling(spun, asked("any", facing))
    assert (outcome.reason if outcome else None) is reason
    if outcome:
        assert "turned away: 60 degrees" in outcome.message


def about_z(degrees: float) -> np.ndarray:
    """(w, x, y, z) of a turn about the vertical."""
    return np.asarray(Rotation.from_euler("z", degrees, degrees=True).as_quat(scalar_first=True))


def test_what_still_moves_when_the_budget_ends_has_no_equilibrium() -> None:
    """The message names the loudest signals with their thresholds."""
    item = body("object", Box(np.array([0.1, 0.1, 0.1])), [0, 0, 0.06], fixed=False)
    found = run(item, table(), asked(), step_limit=5)
    assert isinstance(found, Infeasible)
    assert found.reason is Reason.NO_EQUILIBRIUM
    assert "linear_speed" in found.message


def test_a_step_that_cannot_be_solved_is_reported_as_that() -> None:
    """A bound that no solve can meet: what, where, which bound."""
    item = body("object", Box(np.array([0.1, 0.1, 0.1])), [0, 0, 0.051], fixed=False)
    found = run(item, table(), asked(), acceptable_residual=1e-14, newton_limit=1, impact_share=0.0)
    assert isinstance(found, Infeasible)
    assert found.reason is Reason.UNSTABLE_STEP
    assert "acceptable_residual" in found.message
    assert "t = " in found.message


@pytest.mark.slow
def test_resting_beside_the_base_is_not_resting_on_it() -> None:
    """The share of the weight that the base's own bodies carry decides."""
    item = body("object", Box(np.array([0.1, 0.1, 0.1])), [0, 0, 0.051], fixed=False)
    other = replace(table(), name="box", instance="box")
    particles = Particles((item, other), (), 0.01, ())
    found = drop(particles, anchor(), asked(), 0, DropConfig(threads=2))
    assert isinstance(found, Infeasible)
    assert found.reason is Reason.LEFT_TARGET
    assert placement(found).carried_share.value == 0.0
    on_table = run(item, table(), asked())
    assert isinstance(on_table, Settled)
    particles = Particles((item, table()), (), 0.01, ())
    assert carried_share(on_table, particles, "table") == 1.0


def leaning_board(degrees: float) -> tuple[Particles, Anchor]:
    """A board 40 cm high that touches a wall at y = 0.3 with its upper edge, tilted by so much."""
    angle = np.radians(degrees)
    turn = Rotation.from_rotvec([-angle, 0.0, 0.0]).as_matrix()
    half = np.array([0.1, 0.01, 0.2])
    reach, height = half[1] * np.cos(angle) + half[2] * np.sin(angle), half[1] * np.sin(angle) + half[2] * np.cos(angle)
    item = body("object", Box(2.0 * half), [0.0, 0.299 - reach, height + 0.001], fixed=False, turn=turn)
    floor = body("floor/rigid", Box(np.array([0.8, 0.8, 0.02])), [0.0, 0.0, -0.01], fixed=True)
    wall = replace(body("wall_0", Box(np.array([0.8, 0.04, 0.8])), [0.0, 0.32, 0.4], fixed=True), instance="wall_0")
    lean = Lean("wall_0", float(angle), np.array([0.0, np.sin(angle), np.cos(angle)]))
    return Particles((item, floor, wall), (), 0.01, ()), replace(anchor(), lean=lean)


@pytest.mark.slow
def test_a_leaning_board_stays_and_says_how_it_leans() -> None:
    """At 15 degrees friction 0.6 holds it: tan 15 = 0.27 < 2 mu / (1 - mu^2). The wall's force is, by moments about the
    foot, half the weight times the tangent of the tilt, less what friction at the wall takes, at most mu of it."""
    particles, start = leaning_board(15.0)
    intent = replace(asked("leaning"), orientation=OrientationRequest("leaning", "", "", 0.0, "wall_0"))
    found = drop(particles, start, intent, 0, DropConfig(threads=2))
    assert isinstance(found, Settled)
    assert found.checks is not None
    check = found.checks.lean
    assert check is not None
    assert (check.on, check.asked_rad) == ("wall_0", pytest.approx(np.radians(15.0)))
    assert check.change_rad.holds
    assert check.rest_rad == pytest.approx(check.asked_rad, abs=np.radians(1.0))  # 1 mm above the floor, 1 mm off
    most = 0.5 * np.tan(np.radians(15.0))
    assert 0.4 * most <= check.held_share.value <= most


@pytest.mark.parametrize(
    ("soft", "bonds", "method", "told"),
    [((), (), "tl", "everything is rigid"), (("bed",), ("j",), "mls", "")],
)
def test_mls_leaves_to_tl_what_it_cannot_do(soft, bonds, method, told):
    """And says so; tl needs no other."""
    model: Any = SimpleNamespace(soft_bodies=soft, bonds=bonds)
    config, notes = able(model, SolverConfig(method="mls"))
    assert config.method == method
    assert told in " ".join(notes)
    assert bool(notes) == bool(told)
    assert able(model, SolverConfig()) == (SolverConfig(), ())


HERE = np.array([[[-0.1, -0.1], [0.1, 0.1]]])
BLANKET, MATTRESS = ColumnLayer("blanket", "wool", 0.0, 0.03), ColumnLayer("mattress", "foam", 0.03, 0.2)


def bed(cell: float, instance: str = "bed") -> SoftSimulationBody:
    """A slab of 0.2 m whose top is at 0.2 m, with cells of one height."""
    surface = Box(np.array([0.4, 0.4, 0.2])).surface(0.05)
    mesh = Mesh.of(surface.vertices + np.array([0.0, 0.0, 0.1]), surface.faces)
    sides, heights = np.linspace(-0.2, 0.2, 5), np.linspace(0.0, 0.2, round(0.2 / cell) + 1)
    state = np.zeros((5, 5, len(heights)), np.int8)
    return SoftSimulationBody(
        name=instance, instance=instance, fixed=True, surface=mesh,
        distance=sampled(MeshDistance(mesh), mesh.bounds[0] - 0.01, mesh.bounds[1] + 0.01, 0.02),
        inertial=InertialProperties(1.0, np.zeros(3), np.eye(3)), friction=ContactFriction(0.5, 0.4, 1e-3),
        points=MaterialPoints(np.zeros((1, 3)), np.ones(1), np.ones(1), np.ones(1), np.ones(1)),
        grid=BackgroundGrid(sides, sides, heights, state), loaded=True,
    )  # fmt: skip


def on(body: SoftSimulationBody, *column: ColumnLayer, foreseen: np.ndarray | None = HERE) -> Particles:
    """Something that is to touch it in the middle."""
    return Particles((body,), (), 0.01, (), column=column, foreseen=foreseen)


def test_a_layer_with_too_few_particles_is_refused() -> None:
    """The line says how many there are and what cells would do; those cells do."""
    refuse_coarse_layers(on(bed(0.01), BLANKET, MATTRESS))
    with pytest.raises(
        GeometryError,
        match=r"1\.2 particles through blanket under the contact \(30 mm thick\).*--resolution 0\.02 or finer",
    ):
        refuse_coarse_layers(on(bed(0.05), BLANKET, MATTRESS))
    refuse_coarse_layers(on(bed(0.02), BLANKET, MATTRESS))
    refuse_coarse_layers(on(bed(0.05), MATTRESS))


CELL = 0.0125
SLAB_TOP = 0.06
SIDE = 0.1  # of the plate [m]
THIN = 0.002  # the plate's thickness [m]
FALL = 0.1  # [m]
FOAM = {"density": 60, "youngs_modulus": 2e4, "poisson_ratio": 0.3, "static_friction": 0.5, "dynamic_friction": 0.4}


def plate(thickness: float, height: float) -> RigidSimulationBody:
    """A plate of 2 kg, `height` over the slab [m]."""
    solid, position = Box(np.array([SIDE, SIDE, thickness])), np.array([0.0, 0.0, SLAB_TOP + height + 0.5 * thickness])
    surface = solid.surface(0.01)
    mesh = Mesh.of(surface.vertices + position, surface.faces)
    low, high = mesh.bounds
    grid = sampled(MeshDistance(mesh), low - 0.01, high + 0.01, min(0.35 * thickness, 2e-3))
    inertial = InertialProperties(2.0, position, np.diag(solid.inertia_per_mass * 2.0))
    return RigidSimulationBody(name="plate", instance="object", fixed=False, surface=mesh, distance=grid,
                               inertial=inertial, friction=ContactFriction(0.5, 0.4, 0.0))  # fmt: skip


def on_foam(thickness: float, height: float) -> Model:
    """The plate over a slab of foam that is held at its bottom."""
    steel = {**FOAM, "density": 7800, "youngs_modulus": 2e11}
    cube = {"name": "cube", "shape": {"box": {"size": [SIDE] * 3}}, "position": [0, 0, 0.2], "material": steel}
    slab = {"name": "slab", "shape": {"box": {"size": [0.2, 0.2, SLAB_TOP]}}, "position": [0, 0, 0.5 * SLAB_TOP],
            "motion": "fixed", "material": FOAM}  # fmt: skip
    case = case_particles(checked_case({"bodies": [cube, slab]}, "cube on foam"), Path(), CELL)
    return solver_model(replace(case, bodies=(plate(thickness, height), case.bodies[1])), (0.0, 0.0, -GRAVITY))


@pytest.mark.slow
@pytest.mark.long
def test_a_thin_plate_rests_on_the_foam_it_falls_on() -> None:
    """All foam stays under a plate of a sixth of a cell, and it sinks as far as a thick block of the same base and mass
    does by tl."""
    start(2)
    one = ExplicitDrop(on_foam(THIN, FALL), SolverConfig(method="mls"))
    result = one.run(None)
    depth = -(FALL + float(result.bodies[0].translation[2]))
    local = (one.soft[1].x - one.rigid.state.center[0]) @ one.rigid.state.rotation[0]
    # foam beside the rim may lean over it by its particles' spacing
    above = (np.abs(local[:, :2]) < 0.5 * (SIDE - CELL)).all(axis=1) & (local[:, 2] > 0.5 * THIN)
    assert not above.any()
    thick = settle(on_foam(0.02, 0.001), SolverConfig(threads=2))
    assert (result.verdict, thick.verdict) == ("at_rest", "at_rest")
    assert depth == pytest.approx(-0.001 - float(thick.bodies[0].translation[2]), abs=0.05 * CELL)
