"""The ablation with cells of one size: no finer under the contact, nor through thin parts."""

import numpy as np
import pytest
from box_rooms import ball, block, segmentation, thing

from dcap.scene.types.choices import Anchor, Intent, OrientationRequest, RegionRequest
from dcap.scene.types.materials import BodyModel, Material, PartMaterial, PartMaterials
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.particles import Particles, SoftSimulationBody
from dcap.scene.types.segmentation import SegmentedObject, SegmentedScene
from tasks.particles.config import ParticlesConfig
from tasks.particles.stage import particles

FOAM = Material("foam", 50.0, 2e4, 0.3, 0.6, 0.5, 0.002, "soft", "test")
WOOD = Material("wood", 700.0, 1e10, 0.3, 0.5, 0.4, 0.001, "rigid", "test")
TOP, RADIUS = 0.5, 0.1
FEW = 1500
"""Cells, so that the tests are fast."""


def simulated(**settings: object) -> SoftSimulationBody:
    """A soft mattress of 20 cm, 1.6 m by 2 m, with a soft edge 3 cm thin upright beside a ball of wood."""
    soft = Mesh.concatenate(
        [block((-0.8, -1, TOP - 0.2), (0.8, 1, TOP)), block((0.12, -1, TOP - 0.1), (0.15, 1, TOP + 0.3))]
    )
    parts = [("frame", block((-0.8, -1, 0), (0.8, 1, TOP - 0.2))), ("mattress", soft)]
    scene, item = segmentation({"bed": ("bed", None, parts)}), thing("ball", ball(RADIUS))
    nothing = RegionRequest("", ("center",), (), "")
    intent = Intent("bed", "bed", "ball", np.full(3, 0.2), 2.0, True, 1.0, OrientationRequest("any", "", ""), nothing,
                    (), ())  # fmt: skip
    pose = np.eye(4)
    pose[2, 3] = TOP + RADIUS + 0.01
    square = np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]])
    anchor = Anchor("bed", "mattress", 1, "center", np.zeros(2), np.array([0, 0, TOP]), pose, 0.01, square, "test")
    rows = [("object", "body", 0, WOOD), ("bed", "frame", 0, WOOD), ("bed", "mattress", 1, FOAM)]
    materials = PartMaterials(
        tuple(
            PartMaterial(body, part, index, one, BodyModel.RIGID if one is WOOD else BodyModel.MPM, "")
            for body, part, index, one in rows
        ),
        "none",
    )
    config = ParticlesConfig.model_validate({"base_cells": FEW, "distance_samples": 50_000} | settings)
    found = particles(SegmentedScene(scene), SegmentedObject(item), intent, anchor, materials, config)
    assert isinstance(found, Particles)
    return next(one for one in found.bodies if isinstance(one, SoftSimulationBody))


def sizes(body: SoftSimulationBody) -> np.ndarray:
    """Smallest and largest cell along each axis [m], shape (3, 2)."""
    steps = [np.diff(planes) for planes in body.grid.planes]
    return np.array([[one.min(), one.max()] for one in steps])


@pytest.mark.slow
@pytest.mark.long
def test_cells_are_of_one_size_everywhere():
    """Along each axis within rounding, and alike along all but that a whole number of them fills the box; otherwise
    they are graded: finer under the ball and through the edge than at the rim."""
    even, graded = sizes(simulated(uniform=True)), sizes(simulated())
    np.testing.assert_allclose(even[:, 0], even[:, 1], rtol=1e-6)
    assert even.min() > 0.8 * even.max()
    assert graded[:2, 1].min() > 2.0 * graded[:2, 0].max()
