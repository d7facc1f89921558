"""What is said of a base whose cells cannot resolve all of it."""

import numpy as np
from benches import FOAM, cube_over, soft_layers
from box_rooms import block

from tasks.bodies.soft_cells import Cells
from tasks.bodies.thin_parts import UnderResolved
from tasks.particles.base_bodies import note_cells

SEAT = ("seat", block((-0.6, -0.4, 0.0), (0.6, 0.4, 0.45)), FOAM)
BACK = ("back", block((-0.6, 0.4, 0.0), (0.6, 0.44, 0.9)), FOAM)
PLANES = (np.linspace(-1.0, 1.0, 5),) * 3


def notes(count: int, thin: list[UnderResolved]) -> list[str]:
    """What is noted of this number of cells and of places that are too thin for them."""
    setup = cube_over([SEAT, BACK], 0.45)
    before = len(setup.notes)
    note_cells(setup, soft_layers(setup), Cells(PLANES, 0.5, count), thin)
    return setup.notes[before:]


def test_every_part_that_is_too_thin_for_its_cells_is_named() -> None:
    """Each once, with its worst place."""
    back, seat = np.array([0.0, 0.42, 0.7]), np.array([0.0, 0.0, 0.2])
    found = notes(100, [UnderResolved(1.5, 0.05, back), UnderResolved(1.2, 0.04, back), UnderResolved(1.8, 0.45, seat)])
    assert len(found) == 2
    assert "only 1.2 cells through back where it is 40 mm thick" in found[0]
    assert "only 1.8 cells through seat where it is 450 mm thick" in found[1]
    assert all("budget of 2000 cells (ParticlesConfig.base_cells)" in one for one in found)


def test_cells_beyond_the_budget_are_counted() -> None:
    """Thin parts may take a quarter more than the contact; whoever set the budget is told."""
    (found,) = notes(2400, [])
    assert "2400 cells" in found
    assert "budget of 2000 cells (ParticlesConfig.base_cells)" in found
    assert not notes(2000, [])
