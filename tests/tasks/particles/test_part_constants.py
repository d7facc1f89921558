"""What the parts of a body bring along: stiffness up to a contrast that can be solved, friction point by point."""

from dataclasses import replace

import numpy as np
import pytest
from benches import FOAM as SEAT_FOAM
from benches import cube_over, soft_layers
from box_rooms import block

from dcap.scene.types.materials import BodyModel, LayerConstants, Material, PartMaterial
from tasks.bodies.soft_cells import Cells, Limit, UnderResolved
from tasks.particles.base_bodies import note_cells, note_thin
from tasks.particles.drop_setup import MOST_CONTRAST, constants_of_parts, friction_of_faces, stiffness_of

FOAM = Material("foam", 30.0, 1e4, 0.3, 0.6, 0.5, 0.002, "soft", "test")


def rows(*materials: Material) -> list[PartMaterial]:
    """One part of each material; above 1e9 Pa it is rigid."""
    return [
        PartMaterial("thing", m.id, i, m, BodyModel.RIGID if m.youngs_modulus > 1e9 else BodyModel.MPM, "test")
        for i, m in enumerate(materials)
    ]


def test_soft_parts_keep_their_stiffness_up_to_the_contrast() -> None:
    """Ten thousand times the softest is simulated as it is, more is not; rigid parts only stiffen cells they share."""
    stiff, stiffer, steel = (
        replace(FOAM, id=name, youngs_modulus=e) for name, e in (("pad", 9e7), ("board", 8e8), ("steel", 2e11))
    )
    assert stiffness_of(rows(FOAM, stiff, stiffer, steel)) == [1e4, 9e7, MOST_CONTRAST * 1e4, 100.0 * 1e4]


def test_faces_have_the_friction_of_their_part() -> None:
    """Static, dynamic, rolling of each; nothing where there is no difference."""
    rubber = replace(FOAM, id="rubber", static_friction=0.9, dynamic_friction=0.8, rolling_resistance=0.01)
    part = np.array([0, 1, 1, 0])
    found = friction_of_faces(rows(FOAM, rubber), part)
    assert found is not None
    assert found == pytest.approx(np.array([[0.6, 0.5, 0.002], [0.9, 0.8, 0.01], [0.9, 0.8, 0.01], [0.6, 0.5, 0.002]]))
    assert friction_of_faces(rows(FOAM, rubber), np.zeros(4, dtype=np.int64)) is None
    assert friction_of_faces(rows(FOAM, replace(FOAM, id="other", density=99.0)), part) is None


def test_a_cap_softens_layers_in_all_directions() -> None:
    """Of a part that is taken as a tenth as stiff, along its layers and between them it is a tenth too; the ratios of
    its constants, and with them a positive definite stiffness, stay."""
    layers = LayerConstants(youngs_modulus=4e9, poisson_ratio=0.2, shear_modulus=2e8)
    stack = replace(FOAM, id="stack", youngs_modulus=1e9, layers=layers)
    part = np.array([0, 1])
    found = constants_of_parts(rows(FOAM, stack), part, lambda: np.tile([0.0, 0.0, 1.0], (2, 1)))
    assert found.youngs_modulus == pytest.approx([1e4, 1e8])
    assert found.layers is not None
    assert found.layers.youngs_modulus == pytest.approx([1e4, 4e8])
    assert found.layers.shear_modulus == pytest.approx([1e4 / 2.6, 2e7])
    assert found.layers.poisson_ratio == pytest.approx([0.3, 0.2])


SEAT = ("seat", block((-0.6, -0.4, 0.0), (0.6, 0.4, 0.45)), SEAT_FOAM)
BACK = ("back", block((-0.6, 0.4, 0.0), (0.6, 0.44, 0.9)), SEAT_FOAM)
PLANES = (np.linspace(-1.0, 1.0, 5),) * 3


BACK_PLACE, SEAT_PLACE = np.array([0.0, 0.42, 0.7]), np.array([0.0, 0.0, 0.2])


def notes_of(thin: list[UnderResolved]) -> list[str]:
    """What is noted of places that are too thin for their cells."""
    setup = cube_over([SEAT, BACK], 0.45)
    before = len(setup.notes)
    note_thin(setup, soft_layers(setup), thin)
    return setup.notes[before:]


def notes_of_counts(for_contact: int, count: int) -> list[str]:
    """What is noted of this number of cells where the contact alone asked for fewer."""
    setup = cube_over([SEAT, BACK], 0.45)
    before = len(setup.notes)
    note_cells(setup, Cells(PLANES, 0.5, for_contact), Cells(PLANES, 0.5, count))
    return setup.notes[before:]


def test_every_part_that_is_too_thin_for_its_cells_is_named() -> None:
    """Each once, with its worst place."""
    found = notes_of([
        UnderResolved(1.5, 0.05, BACK_PLACE, Limit.FINEST), UnderResolved(1.2, 0.04, BACK_PLACE, Limit.BUDGET),
        UnderResolved(1.8, 0.45, SEAT_PLACE, Limit.BUDGET),
    ])  # fmt: skip
    assert len(found) == 2
    assert "only 1.2 cells through back where it is 40 mm thick" in found[0]
    assert "only 1.8 cells through seat where it is 450 mm thick" in found[1]
    assert all("budget of 2000 cells (ParticlesConfig.base_cells)" in one for one in found)
    assert not notes_of([])


def test_cells_beyond_the_budget_are_counted() -> None:
    """Thin parts may take a quarter more than the budget; whoever set it is told, but not that cells are for what is
    thin which the contact took."""
    (found,) = notes_of_counts(1900, 2400)
    assert "2400 cells instead of 1900" in found
    assert "budget of 2000 cells (ParticlesConfig.base_cells)" in found
    assert not notes_of_counts(1500, 2000)
    assert not notes_of_counts(2400, 2400)
