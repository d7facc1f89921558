"""Where bodies of a case will press on each other, seen before anything is simulated, and the cells that follow."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from tasks.bodies.soft_cells import CELLS_ACROSS, CELLS_AT_EDGES
from tasks.case.bodies import BUDGET, case_particles
from tasks.case.contacts import predicted_contacts
from tasks.case.file import checked_case
from tasks.case.solid import CaseSolid

FOAM = {"density": 60, "youngs_modulus": 5e4, "poisson_ratio": 0.3, "static_friction": 0.5, "dynamic_friction": 0.4}
SLAB = {"name": "slab", "shape": {"box": {"size": [0.4, 0.4, 0.15]}}, "position": [0, 0, 0.075], "motion": "fixed",
        "material": FOAM}  # fmt: skip


def body(shape, height, **more):
    return {"name": "thing", "shape": shape, "position": [0, 0, height], "mass": 2.0, "material": "steel"} | more


def contacts(*bodies, bonds=()):
    """The predicted contacts of bodies on the slab."""
    case = checked_case({"bodies": [SLAB, *bodies], "bonds": [list(one) for one in bonds]}, "case")
    solids = [
        CaseSolid(one, Path(), frozenset(n for pair in bonds for n in pair if one.name in pair and n != one.name))
        for one in case.bodies
    ]
    return predicted_contacts(solids, 9.81)


def lying(axis):
    return Rotation.from_euler(axis, 90.0, degrees=True).as_quat(scalar_first=True).tolist()


def test_a_lying_capsule_touches_along_its_whole_length():
    """Not only in its middle; across it is as narrow as a line of contact."""
    (found,) = contacts(body({"capsule": {"radius": 0.04, "length": 0.1}}, 0.2, quaternion=lying("y")))
    x, along = found.plan.across(0)
    _, across = found.plan.across(1)
    assert np.ptp(x) > 0.09
    assert along.max() > 3.0 * across.max()
    assert found.plan.half_width == pytest.approx(np.median(across), rel=0.4)


def test_a_cube_on_its_edge_touches_in_a_line():
    """Its true underside decides, whatever its box is."""
    turn = Rotation.from_euler("x", 45.0, degrees=True).as_quat(scalar_first=True).tolist()
    (found,) = contacts(body({"box": {"size": [0.1, 0.1, 0.1]}}, 0.23, quaternion=turn, motion="vertical"))
    assert found.plan.half_width < 0.02
    assert np.ptp(found.plan.across(0)[0]) == pytest.approx(0.1, abs=0.005)


@pytest.mark.long
def test_cells_are_finest_at_an_edge_as_far_as_the_budget_goes():
    """A flat cylinder gets all that it needs; a brick that lies askew, whose edges cross every cell, gets a part."""
    askew = Rotation.from_euler("z", 30.0, degrees=True).as_quat(scalar_first=True).tolist()
    flat = body({"cylinder": {"radius": 0.05, "height": 0.1}}, 0.21)
    brick = body({"box": {"size": [0.24, 0.11, 0.07]}}, 0.2, quaternion=askew)
    for thing, factor in ((flat, CELLS_AT_EDGES), (brick, 1.3 * CELLS_ACROSS)):
        (found,) = contacts(thing)
        slab = case_particles(checked_case({"bodies": [SLAB, thing]}, "case"), Path(), None).bodies[0]
        x, y, z = slab.grid.planes  # type: ignore[union-attr]
        rim = np.abs(0.5 * (x[1:] + x[:-1]) - found.plan.edges(0).max()).argmin()
        assert np.diff(x)[rim] <= 1.05 * found.plan.half_width / factor
        assert (len(x) - 1) * (len(y) - 1) * (len(z) - 1) <= BUDGET


def test_what_falls_past_has_no_contact():
    """Nor has what is covered by a layer that is bonded to it."""
    assert contacts(body({"sphere": {"radius": 0.05}}, 0.3) | {"position": [0.5, 0, 0.3]}) == []
    cover = {"name": "cover", "shape": {"box": {"size": [0.4, 0.4, 0.02]}}, "position": [0, 0, 0.16],
             "material": FOAM}  # fmt: skip
    found = contacts(cover, body({"sphere": {"radius": 0.05}}, 0.23), bonds=[("cover", "slab")])
    assert [(one.upper.body.name, one.lower.body.name) for one in found] == [("thing", "cover")]


def test_cells_follow_the_patch_within_the_budget():
    """A fifth of half its width across, larger along a line, fine under a cover too; at most the budget."""
    capsule = body({"capsule": {"radius": 0.04, "length": 0.1}}, 0.2, quaternion=lying("y"))
    case, (found,) = checked_case({"bodies": [SLAB, capsule]}, "case"), contacts(capsule)
    slab = case_particles(case, Path(), None).bodies[0]
    x, y, z = (np.diff(p) for p in slab.grid.planes)  # type: ignore[union-attr]
    assert y.min() <= 1.1 * found.plan.across(1)[1].max() / CELLS_ACROSS
    assert z.min() <= 1.01 * found.plan.half_width / CELLS_ACROSS
    assert x.min() > 1.5 * y.min()
    assert len(x) * len(y) * len(z) <= BUDGET
