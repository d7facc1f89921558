"""The stages that measure a final state, on poses whose answers are known without a drop."""

import sys
from dataclasses import replace
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
import trimesh
from box_rooms import block, segmentation, thing

from dcap.geometry.primitives import Box
from dcap.geometry.raycast import Raycaster
from dcap.scene.types.choices import Anchor, Intent, OrientationRequest, RegionRequest
from dcap.scene.types.materials import BodyModel, Material, PartMaterial, PartMaterials
from dcap.scene.types.measures import Indentation
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.outcome import Infeasible
from dcap.scene.types.particles import GRAVITY, ColumnLayer, Particles
from dcap.scene.types.segmentation import Segmentation, SegmentedObject, SegmentedScene
from solver.certificate import Verdict
from tasks.bodies.footprint import heights_over
from tasks.bodies.plan_contact import Layer, plan_contact
from tasks.measure.drift import DriftConfig, drift, indentation
from tasks.measure.referee import frictions, referee
from tasks.measure.touch import measure
from tasks.particles.config import ParticlesConfig
from tasks.particles.contact_layers import RIGID
from tasks.particles.stage import particles, proposal_particles
from tasks.posed.stage import posed

RADIUS, TOP, DEPTH = 0.05, 0.5, 12.166e-3
"""Of a ball of 1 kg and of a foam slab of 15 cm and 20 kPa, and how deep finite elements press the one into the other
(0.40 x 0.40 m, bottom bonded) [m]."""
FOAM = Material("foam", 50.0, 2e4, 0.3, 0.6, 0.5, 0.002, "soft", "test")
WOOD = Material("wood", 700.0, 1e10, 0.3, 0.5, 0.4, 0.001, "rigid", "test")


def ball() -> Segmentation:
    shape = trimesh.creation.icosphere(5, RADIUS)
    return thing("ball", Mesh.of(shape.vertices, shape.faces))


def room() -> Segmentation:
    """A bed of 0.4 m by 0.4 m with a mattress on a frame."""
    parts = [("frame", block((-0.2, -0.2, 0), (0.2, 0.2, TOP - 0.15))),
             ("mattress", block((-0.2, -0.2, TOP - 0.15), (0.2, 0.2, TOP)))]  # fmt: skip
    return segmentation({"bed": ("bed", None, parts)})


def intent() -> Intent:
    free, nothing = OrientationRequest("any", "", ""), RegionRequest("", ("center",), (), "")
    return Intent("bed", "bed", "ball", np.full(3, 0.1), 1.0, True, 1.0, free, nothing, (), ())


def anchor(x: float, height: float) -> Anchor:
    """The ball's lowest point at a height [m]."""
    pose = np.eye(4)
    pose[:3, 3] = x, 0.0, height + RADIUS
    square = np.array([[-0.2, -0.2], [0.2, -0.2], [0.2, 0.2], [-0.2, 0.2]])
    return Anchor("bed", "mattress", 1, "center", np.zeros(2), np.array([0, 0, TOP]), pose, 0.0, square, "test")


def made_of(item: Material, mattress: Material) -> PartMaterials:
    rows = [("object", "body", 0, item), ("bed", "frame", 0, WOOD), ("bed", "mattress", 1, mattress)]
    return PartMaterials(
        tuple(
            PartMaterial(body, part, index, one, BodyModel.RIGID if one is WOOD else BodyModel.MPM, "")
            for body, part, index, one in rows
        ),
        "none",
    )


def sunk(height: float, *, x: float = 0.0, item: Material = WOOD, mattress: Material = FOAM) -> Indentation:
    """How deep the ball is that was left with its lowest point at a height [m]."""
    column = (ColumnLayer("mattress", "foam", 0.0, 0.15),) if mattress is FOAM else ()
    bodies = cast(Particles, SimpleNamespace(column=column))  # the measure looks at the layers alone
    where, thing_ = anchor(x, height), SegmentedObject(ball())
    settled = posed(thing_, where)
    return indentation(SegmentedScene(room()), thing_, intent(), where, made_of(item, mattress), bodies, settled)


@pytest.mark.parametrize("left", [0.0, 0.003, DEPTH, 0.03])
def test_a_ball_ought_to_be_as_deep_as_finite_elements_press_it(left: float):
    """Within the 4 % that the documentation states, however deep it was left, which is told apart."""
    found = sunk(TOP - left)
    assert found.reference_m == pytest.approx(DEPTH, rel=0.04)
    # heights are float32: 3e-8 m of 12 mm
    assert found.reference_m == pytest.approx(sunk(TOP).reference_m or 0.0, rel=1e-5)
    # the nearest of 96 x 96 lines passes the lowest point at R sqrt(2) / 96 at most, where the ball is 5 um higher; its
    # facets, 1.7 mm wide, lie up to 1.7^2 / 8 R = 7 um inside of it
    assert found.found_m == pytest.approx(left, abs=2e-5)


def test_what_floats_is_not_sunk_at_all():
    found = sunk(TOP + 0.2)
    assert found.found_m == 0.0
    assert found.reference_m == pytest.approx(DEPTH, rel=0.04)


def test_a_posed_object_is_where_its_anchor_says_and_nothing_else_has_moved():
    """Verdict as_posed, one body, no contacts, no certificate and no history of a drop."""
    item, where = SegmentedObject(ball()), anchor(0.07, TOP + 0.2)
    found = posed(item, where)
    assert (found.verdict, [one.name for one in found.bodies]) == (Verdict.AS_POSED, ["object"])
    np.testing.assert_allclose(
        found.bodies[0].surface.vertices, item.mesh.vertices + np.array([0.07, 0.0, TOP + 0.2 + RADIUS])
    )
    np.testing.assert_array_equal(found.bodies[0].world_from_start, np.eye(4))
    assert not found.bodies[0].displacement.any()
    assert (found.contacts, found.certificate, len(found.history.time)) == ((), None, 0)


@pytest.mark.parametrize(("x", "height"), [(0.0, 0.2), (0.19, 0.05), (0.0, 0.0)])
def test_what_is_beneath_is_told_with_its_distance(x: float, height: float):
    """The bed's mattress, whatever the height; the ball's middle over it counts as carried."""
    item, where = SegmentedObject(ball()), anchor(x, TOP + height)
    found = measure(SegmentedScene(room()), item, where, posed(item, where))
    assert (found.support_id, found.support_label, found.support_part) == ("bed", "bed", "mattress")
    assert found.gap_m == pytest.approx(height, abs=2e-5)
    assert (found.penetration_m, found.penetration_given_m) == (pytest.approx(0.0, abs=1e-6),) * 2
    assert found.com_margin_m >= -1e-3


def test_a_dent_of_which_nothing_is_kept_is_not_simulated_on():
    """Surfaces of another shape than at the start, and no displacements inside: unknown, and no fault of the state."""
    where = anchor(0.0, TOP)
    found = posed(SegmentedObject(ball()), where)
    body = found.bodies[0]
    pressed = Mesh(body.surface.vertices * [1.0, 1.0, 0.99], body.surface.faces, body.surface.colors)
    dented = replace(body, surface=pressed, displacement=pressed.vertices - body.surface.vertices)
    nothing = cast(Particles, None)
    told = drift(nothing, replace(found, bodies=(dented,)), DriftConfig())
    assert "keeps no displacements inside object" in told.reason
    assert (told.seconds, told.broken) == (0.0, False)


@pytest.mark.slow
def test_a_pose_of_which_no_bodies_can_be_made_is_no_failure():
    """More material points than are allowed, which a drop refuses, are told for a pose, which is measured without."""
    given = SegmentedScene(room()), SegmentedObject(ball()), intent(), anchor(0.0, TOP), made_of(WOOD, FOAM)
    found = proposal_particles(*given, ParticlesConfig(particle_limit=1))
    assert isinstance(found, Infeasible)
    assert "particles > 1" in found.message


@pytest.mark.slow
def test_what_floats_over_nothing_falls_freely():
    """g t^2 / 2 for as long as it is simulated on, all of its weight unbalanced, without a turn: beside the bed, which
    is simulated all the same."""
    item, where = SegmentedObject(ball()), anchor(0.32, TOP + 0.3)
    bodies = particles(
        SegmentedScene(room()), item, intent(), where, made_of(WOOD, WOOD), ParticlesConfig(least_crop_margin=0.3)
    )
    assert isinstance(bodies, Particles)
    found = drift(bodies, posed(item, where), DriftConfig(seconds=0.4, threads=2))
    assert (found.reason, found.broken) == ("", False)
    assert found.seconds > 0.1
    # backward Euler falls g t (t + dt) / 2, and the steps are bounded
    lower = 0.5 * 9.81 * found.seconds**2
    longest = found.seconds / max(found.steps, 1)
    assert lower <= found.distance_m <= lower + 9.81 * found.seconds * 4.0 * longest
    # what was not simulated of the 0.4 s that were asked counts as balanced
    assert found.force_residual == pytest.approx(found.seconds / 0.4, rel=1e-3)
    assert found.angle_rad < 1e-6


@pytest.mark.slow
def test_the_referee_judges_a_pose_with_the_mass_and_friction_of_its_drop(monkeypatch: pytest.MonkeyPatch):
    """A cube 2 mm over the bed lands there; beside the bed it falls past it and is no longer supported; without MuJoCo
    there are no numbers, and the reason says what to install."""
    cube = SegmentedObject(thing("ball", block((-RADIUS, -RADIUS, -RADIUS), (RADIUS, RADIUS, RADIUS))))
    scene, gap = SegmentedScene(room()), 2e-3
    over, beside = anchor(0.0, TOP + gap), anchor(0.3, TOP + gap)
    bodies = proposal_particles(scene, cube, intent(), over, made_of(WOOD, WOOD), ParticlesConfig())
    assert isinstance(bodies, Particles)
    # wood on wood, the geometric mean of 0.5 and 0.5, rolling resistance 1 mm
    np.testing.assert_allclose(frictions(scene, made_of(WOOD, WOOD), bodies), [[0.5, 0.001]] * 2)
    given = made_of(WOOD, WOOD), bodies, posed(cube, over)
    found = referee(scene, cube, over, *given, measure(scene, cube, over, posed(cube, over)))
    assert found.drift_m == pytest.approx(gap, abs=2e-4)  # a step of 0.5 ms at 0.2 m/s, and rest within 1e-5
    assert (found.supported, found.carrier_id, found.penetration_m, found.reason) == (True, "bed", 0.0, "")
    fallen = referee(scene, cube, beside, made_of(WOOD, WOOD), bodies, posed(cube, beside),
                     measure(scene, cube, over, posed(cube, over)))  # fmt: skip
    assert fallen.drift_m == pytest.approx(0.5 * 9.81, rel=1e-2)
    assert (fallen.supported, fallen.carrier_id) == (False, "")
    monkeypatch.setitem(sys.modules, "mujoco", None)
    unknown = referee(scene, cube, over, *given, measure(scene, cube, over, posed(cube, over)))
    assert (unknown.drift_m, unknown.supported, unknown.seconds) == (None, None, None)
    assert "pip install dcap[referee]" in unknown.reason


def over(shape: trimesh.Trimesh) -> Mesh:
    """A shape 1 cm over the slab, whose top is at 7.5 cm."""
    shape.apply_translation([0.0, 0.0, 0.085 - shape.bounds[0, 2]])
    return Mesh.of(np.asarray(shape.vertices), np.asarray(shape.faces))


def foam(young: float, poisson: float = 0.3, thickness: float = 0.15) -> Layer:
    return thickness, (1.0 - poisson**2) / young


def lying_capsule() -> trimesh.Trimesh:
    shape = trimesh.creation.capsule(height=0.10, radius=0.04, count=[64, 64])
    return shape.apply_transform(trimesh.transformations.rotation_matrix(np.pi / 2, [0, 1, 0]))


@pytest.mark.parametrize(
    ("shape", "mass", "layers", "depth"),
    [
        (trimesh.creation.icosphere(5, 0.05), 1.0, [foam(2e4)], 12.166e-3),
        (trimesh.creation.icosphere(5, 0.05), 1.0, [foam(5e5)], 1.488e-3),
        (trimesh.creation.icosphere(5, 0.05), 1.0, [foam(1.2e4, 0.2, 0.02), foam(4e4, 0.3, 0.23)], 12.547e-3),
        (trimesh.creation.cylinder(0.04, 0.1, sections=128), 1.5, [foam(5e4)], 2.617e-3),
        (lying_capsule(), 3.0, [foam(5e4)], 7.092e-3),
    ],
    ids=["ball", "ball on stiff foam", "ball on a cover", "flat cylinder", "lying capsule"],
)
def test_the_reference_is_near_finite_elements(
    shape: trimesh.Trimesh, mass: float, layers: list[Layer], depth: float
) -> None:
    """Static finite elements of a slab of 0.40 x 0.40 x 0.15 m (the covered one 0.25 m), bottom bonded."""
    slab, thing = Box(np.array([0.4, 0.4, 0.15])).surface(10.0), over(shape)
    stacks = ([(1.0, 0.0)], [*layers, RIGID])
    found = plan_contact(heights_over(thing, Raycaster(slab)), thing.bounds[:, :2], mass * GRAVITY, stacks)
    assert found is not None
    assert found.patch.approach == pytest.approx(depth, rel=0.04)  # the worst, on a cover, is 3.97 % off
