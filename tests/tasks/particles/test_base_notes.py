"""What is said of a base whose cells cannot resolve all of it."""

import numpy as np
from benches import FOAM, cube_over, soft_layers
from box_rooms import block

from tasks.bodies.soft_cells import Cells, Limit, UnderResolved
from tasks.particles.base_bodies import note_cells, note_thin

SEAT = ("seat", block((-0.6, -0.4, 0.0), (0.6, 0.4, 0.45)), FOAM)
BACK = ("back", block((-0.6, 0.4, 0.0), (0.6, 0.44, 0.9)), FOAM)
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
