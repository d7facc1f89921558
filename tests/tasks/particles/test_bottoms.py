"""How deep a soft base reaches: covers on what carries them, soft or rigid, in whatever order its parts are listed."""

from collections.abc import Sequence

import numpy as np
import pytest
from benches import CLOTH, FOAM, WOOD, Named, cube_over, soft_layers
from box_rooms import block
from furnished import sheet

from dcap.scene.types.mesh import Mesh
from tasks.particles.contact_layers import soft_bottoms

SEAT, THICK, WAVE = 0.45, 0.008, 0.012
SIDE = 0.3


def wavy(mesh: Mesh) -> Mesh:
    """Raised by waves of 2 WAVE from crest to trough [m]."""
    lift = WAVE * (1.0 - np.cos(2.0 * np.pi * mesh.vertices[:, 0] / 0.2))
    return Mesh.of(mesh.vertices + lift[:, None] * [0.0, 0.0, 1.0], mesh.faces)


def bottoms(parts: Sequence[Named], height: float) -> dict[str, float]:
    """Bottom of each soft part [m]."""
    setup = cube_over(parts, height)
    layers = soft_layers(setup)
    found = soft_bottoms(setup, layers)
    return {parts[i][0]: float(found[layers.part == i].max()) for i in set(layers.part.tolist())}


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
