"""Benches of named parts with a wooden cube above them, as the stage that fills bodies is given them."""

from collections.abc import Sequence

import numpy as np
from box_rooms import block, segmentation

from dcap.scene.types.choices import Anchor, Intent, OrientationRequest, RegionRequest
from dcap.scene.types.materials import BodyModel, Material, PartMaterial, PartMaterials
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.segmentation import SegmentedObject, SegmentedScene
from tasks.particles.base_bodies import base_layers
from tasks.particles.config import ParticlesConfig
from tasks.particles.drop_setup import DropSetup, drop_setup
from tasks.particles.layers import BaseLayers

FOAM = Material("foam", 50.0, 2e4, 0.3, 0.6, 0.5, 0.002, "soft", "test")
WOOD = Material("wood", 700.0, 1e10, 0.3, 0.5, 0.4, 0.001, "rigid", "test")
CLOTH = Material("cloth", 200.0, 1e5, 0.2, 0.6, 0.5, 0.002, "soft", "test")
Named = tuple[str, Mesh, Material]


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


def soft_layers(setup: DropSetup) -> BaseLayers:
    """The soft parts of the bench with their covers."""
    rows = setup.materials.of_parts("bench_0", len(setup.base.parts))
    soft = [row.part_index for row in rows if row.model is BodyModel.MPM]
    faces = np.flatnonzero(np.isin(setup.scene.face_part, soft))
    return base_layers(setup, rows, setup.scene.mesh.submesh(faces), setup.scene.face_part[faces])
