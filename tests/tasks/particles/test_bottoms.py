"""How deep a soft base reaches: covers on what carries them, soft or rigid, in whatever order its parts are listed."""

from collections.abc import Sequence

import numpy as np
import pytest
from box_rooms import block, segmentation
from furnished import sheet

from dcap.scene.types.anchor import Anchor
from dcap.scene.types.intent import Intent, OrientationRequest, RegionRequest
from dcap.scene.types.materials import BodyModel, Material, PartMaterial, PartMaterials
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.segmentation import SegmentedObject, SegmentedScene
from tasks.particles.base_bodies import base_layers
from tasks.particles.bottoms import soft_bottoms
from tasks.particles.config import ParticlesConfig
from tasks.particles.drop_setup import DropSetup, drop_setup

FOAM = Material("foam", 50.0, 2e4, 0.3, 0.6, 0.5, 0.002, "soft", "test")
WOOD = Material("wood", 700.0, 1e10, 0.3, 0.5, 0.4, 0.001, "rigid", "test")
CLOTH = Material("cloth", 200.0, 1e5, 0.2, 0.6, 0.5, 0.002, "soft", "test")
SEAT, THICK, WAVE = 0.45, 0.008, 0.012
SIDE = 0.3
Named = tuple[str, Mesh, Material]


def wavy(mesh: Mesh) -> Mesh:
    """Raised by waves of 2 WAVE from crest to trough [m]."""
    lift = WAVE * (1.0 - np.cos(2.0 * np.pi * mesh.vertices[:, 0] / 0.2))
    return Mesh.of(mesh.vertices + lift[:, None] * [0.0, 0.0, 1.0], mesh.faces)


def cube_over(parts: Sequence[Named], height: float) -> DropSetup:
    """A wooden cube of 8 cm, a centimetre above a height [m] of a bench of these parts."""
    bench = segmentation({"bench_0": ("bench", None, [(name, mesh) for name, mesh, _ in parts])})
    cube = segmentation({"object": ("cube", None, [("body", block((-0.04, -0.04, -0.04), (0.04, 0.04, 0.04)))])})
    pose = np.eye(4)
    pose[2, 3] = height + 0.05
    intent = Intent("bench_0", "bench", "cube", np.full(3, 0.08), 0.35, False, 1.0,
                    OrientationRequest("any", "", ""), RegionRequest("", ("center",), (), ""), (), ())  # fmt: skip
    surface = np.array([0.0, 0.0, height])
    polygon = np.array([[-0.3, -0.3], [0.3, -0.3], [0.3, 0.3], [-0.3, 0.3]])
    anchor = Anchor("bench_0", parts[0][0], 0, "center", np.zeros(2), surface, pose, 0.01, polygon, "test")
    named = [("object", "body", 0, WOOD), *(("bench_0", name, i, m) for i, (name, _, m) in enumerate(parts))]
    rows = [
        PartMaterial(body, part, index, material, BodyModel.RIGID if material is WOOD else BodyModel.MPM, "test")
        for body, part, index, material in named
    ]
    materials = PartMaterials(tuple(rows), "none")
    return drop_setup(
        SegmentedScene(bench), SegmentedObject(cube), intent, anchor, materials, ParticlesConfig(base_cells=2000)
    )


def bottoms(parts: Sequence[Named], height: float) -> dict[str, float]:
    """Bottom of each soft part [m]."""
    setup = cube_over(parts, height)
    rows = setup.materials.of_parts("bench_0", len(parts))
    soft = np.isin(setup.scene.face_part, [i for i, (_, _, m) in enumerate(parts) if m is not WOOD])
    faces = np.flatnonzero(soft)
    part = setup.scene.face_part[faces]
    found = soft_bottoms(setup, base_layers(setup, rows, setup.scene.mesh.submesh(faces), part))
    return {parts[i][0]: float(found[part == i].max()) for i in set(part.tolist())}


BENCH = ("seat", block((-0.6, -0.4, 0.0), (0.6, 0.4, SEAT)), WOOD)
TOWEL = ("towel", wavy(sheet((-SIDE, SIDE), (-SIDE, SIDE), SEAT + THICK, 0.02)), CLOTH)


@pytest.mark.parametrize("parts", [[BENCH, TOWEL], [TOWEL, BENCH]])
def test_a_wavy_cloth_touches_what_is_rigid_in_its_troughs(parts: Sequence[Named]) -> None:
    """It reaches down by its thickness from its lowest place, not from its middle height, 12 mm above the bench."""
    found = bottoms(parts, SEAT + THICK + 2.0 * WAVE)
    assert found["towel"] == pytest.approx(SEAT)  # of waves of 24 mm no even step is seen: 8 mm, as is usual


@pytest.mark.parametrize("order", [(0, 1), (1, 0)])
def test_what_carries_is_seen_to_before_what_is_carried(order: Sequence[int]) -> None:
    """A seat that is seen as a sheet is taken as 4 cm thick, and the throw on it ends there too, listed before or
    after."""
    foam = ("seat", sheet((-0.6, 0.6), (-0.4, 0.4), SEAT), FOAM)
    throw = ("throw", sheet((-SIDE, SIDE), (-SIDE, SIDE), SEAT + 0.02), CLOTH)
    found = bottoms([(foam, throw)[i] for i in order], SEAT + 0.02)
    assert found == pytest.approx({"seat": SEAT - 0.04, "throw": SEAT - 0.04})
