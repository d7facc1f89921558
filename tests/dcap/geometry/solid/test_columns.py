"""The solid under what is seen is closed and where the surface was, whatever else the scan has."""

import numpy as np
import pytest
from torn import ball, fine_box, middles, scrap, where, with_hole

from dcap.geometry.distance import MeshDistance
from dcap.geometry.solid.columns import column_solid
from dcap.geometry.solid.repair_log import RepairLog
from dcap.geometry.solid.soundness import agreement, well_formed
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.scan import Method

TOP = 0.4
REGION = np.array([[-0.15, -0.2, 0.2], [0.15, 0.22, 0.7]])
SEAT = fine_box((-0.5, -0.4, 0.0), (0.5, 0.4, TOP))
BACK = fine_box((-0.5, 0.15, 0.0), (0.5, 0.4, 0.9))


def item(at: tuple[float, float, float] = (0.0, -0.05, TOP + 0.07)) -> Mesh:
    """A ball of 12 cm, a centimetre over the seat."""
    return Mesh.of(ball(0.06).vertices + np.array(at), ball(0.06).faces)


def solid_under(mesh: Mesh) -> tuple[MeshDistance, Mesh, str]:
    """Its distance, its surface, and what the report says against it."""
    found = column_solid(mesh, np.zeros(len(mesh.faces)), REGION, item(), 5e-3, RepairLog())
    assert found is not None
    assert found.report.method is Method.COLUMNS
    assert found.report.closed == well_formed(found.mesh)
    return MeshDistance(found.mesh), found.mesh, found.report.problem


def damaged(mesh: Mesh) -> Mesh:
    """Without underside, back and a tenth of its faces, with a second layer 8 mm below its top and scraps inside."""
    rng = np.random.default_rng(2)
    seen = where(mesh, (middles(mesh)[:, 2] > 1e-6) & (middles(mesh)[:, 1] < 0.4 - 1e-6))
    top = where(seen, middles(seen)[:, 2] > TOP - 1e-6)
    layer = Mesh.of(top.vertices - (0.0, 0.0, 0.008), top.faces)
    kept = where(seen, rng.random(len(seen.faces)) > 0.1)
    return Mesh.concatenate([kept, layer, *(scrap((x, 0.0, 0.2)) for x in (-0.2, 0.0, 0.2))])


@pytest.mark.parametrize("damage", [False, True])
def test_the_solid_is_sound_and_where_the_surface_was(damage: bool) -> None:
    """Closed, sure of its inside, its top where it was; where faces are missing the layer below shows or the hole is
    closed: 8 mm at most."""
    field, surface, problem = solid_under(damaged(SEAT) if damage else SEAT)
    assert not problem
    assert agreement(surface) > 0.999
    x, y = np.meshgrid(np.linspace(-0.1, 0.1, 9), np.linspace(-0.15, 0.05, 9))
    above, below = (np.c_[x.ravel(), y.ravel(), np.full(x.size, TOP + dz)] for dz in (0.002, -0.0095))
    assert not field.inside(above).any()
    assert field.inside(below).all()


def test_material_goes_on_behind_a_back_that_the_object_does_not_look_over() -> None:
    """The back is higher than the ball: its columns are solid up to the top of the region, also where its front is torn
    and one looks into it."""
    torn = (np.abs(middles(BACK) - np.array([0.0, 0.15, 0.6])) < np.array([0.04, 0.01, 0.06])).all(axis=1)
    field, _, problem = solid_under(Mesh.concatenate([SEAT, where(BACK, np.asarray(~torn))]))
    assert not problem
    inside_back = np.array([[x, 0.2, z] for x in (-0.1, 0.0, 0.1) for z in (0.45, 0.52)])
    assert field.inside(inside_back).all()
    assert not field.inside(np.array([[0.0, 0.1, 0.5], [0.12, 0.0, 0.45]])).any()


def test_a_board_over_the_object_is_not_what_carries_it() -> None:
    """On the lower of two boards the space between them stays free."""
    board = fine_box((-0.5, -0.4, 0.6), (0.5, 0.4, 0.62))
    field, _, _ = solid_under(Mesh.concatenate([SEAT, board]))
    assert not field.inside(np.array([[0.0, -0.05, 0.5], [0.12, 0.1, 0.5]])).any()
    assert field.inside(np.array([[0.0, -0.05, 0.39]])).all()


def test_a_hole_is_closed_and_told() -> None:
    """Also where the mending of the whole thing did not see it."""
    torn = with_hole(SEAT, (0.0, -0.05), (0.12, 0.1))
    found = column_solid(torn, np.zeros(len(torn.faces)), REGION, item(), 5e-3, RepairLog())
    assert found is not None
    assert len(found.holes) == 1
    assert any("closed from their rims" in line for line in found.report.repairs)
    assert MeshDistance(found.mesh).inside(np.array([[0.0, -0.05, TOP - 0.003]])).all()


def test_where_nothing_is_seen_there_is_no_solid() -> None:
    """None, for the caller to tell."""
    away = Mesh.of(SEAT.vertices + np.array([5.0, 0.0, 0.0]), SEAT.faces)
    assert column_solid(away, np.zeros(len(away.faces)), REGION, item(), 5e-3, RepairLog()) is None


@pytest.mark.parametrize("apart", [0.6, pytest.param(0.11, marks=pytest.mark.long)])
def test_ribs_narrower_than_a_column_are_told(apart: float) -> None:
    """3 mm wide and 30 mm high under a plate of 1.2 m, whose columns are 10 mm wide: between two looks, or met by some.
    Nothing of that is less than its height off where no column has it."""
    plate = fine_box((-0.6, -0.6, TOP + 0.05), (0.6, 0.6, TOP + 0.07), 1)
    slab = fine_box((-1.5, -1.5, 0.0), (1.5, 1.5, TOP), 1)
    ribs = [fine_box((x, -0.5, TOP), (x + 0.003, 0.5, TOP + 0.03), 1) for x in np.arange(-0.5, 0.51, apart) + 0.0044]
    region = np.array([[-1.2, -1.2, 0.2], [1.2, 1.2, 0.7]])
    for mesh, told in ((slab, False), (Mesh.concatenate([slab, *ribs]), True)):
        found = column_solid(mesh, np.zeros(len(mesh.faces)), region, plate, 5e-3, RepairLog())
        assert found is not None
        assert bool(found.report.problem) == told
        assert found.report.hausdorff == pytest.approx(0.03 if told else 0.0, abs=1e-3)


def test_clefts_narrower_than_a_column_and_holes_that_were_closed_are_no_problem() -> None:
    """Nothing reaches in there."""
    boards = [fine_box((x, -0.4, TOP - 0.02), (x + 0.0989, 0.4, TOP), 2) for x in np.arange(-5, 5) * 0.1]
    ground = fine_box((-0.5, -0.4, 0.0), (0.5, 0.4, 0.1), 2)
    mesh = Mesh.concatenate([ground, *boards])
    found = column_solid(mesh, np.zeros(len(mesh.faces)), REGION, item(), 5e-3, RepairLog())
    assert found is not None
    assert not found.report.problem
    assert found.report.hausdorff < 3e-3
