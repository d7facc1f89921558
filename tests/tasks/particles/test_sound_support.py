"""What carries is a sound solid where the object goes, and what was done to a scan is said."""

import numpy as np
import pytest
from benches import FOAM, WOOD, cube_over
from torn import fine_box, middles, normals, scrap, where, with_hole

from dcap.geometry.distance import sampler
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.scan import Method
from tasks.particles.base_bodies import BaseBodies, base_bodies
from tasks.particles.drop_setup import DropSetup

TOP = 0.45
SEAT = fine_box((-0.15, -0.15, 0.3), (0.15, 0.15, TOP), rounds=4)


def built(mesh: Mesh, *, wooden: bool = False) -> tuple[DropSetup, BaseBodies]:
    """The bodies of a bench of one part under a cube."""
    setup = cube_over([("seat", mesh, WOOD if wooden else FOAM)], TOP)
    return setup, base_bodies(setup)


def highest(found: BaseBodies) -> float:
    """Where the distance under the cube's middle changes its sign [m]."""
    z = np.arange(TOP + 0.03, TOP - 0.05, -5e-4)
    points = np.c_[np.full(len(z), 0.003), np.full(len(z), 0.002), z]
    inside = sampler(found.bodies[0].distance)(points) < 0.0
    assert inside.any()
    return float(z[np.argmax(inside)])


@pytest.mark.parametrize("wooden", [pytest.param(True, marks=pytest.mark.long), False])
def test_a_hole_under_the_object_is_closed_and_said(wooden):
    """The surface goes on at its height, to 1 mm, and the words have its size."""
    torn = with_hole(where(SEAT, normals(SEAT)[:, 2] > -0.5), (0.0, 0.0), (0.12, 0.1))
    setup, found = built(torn, wooden=wooden)
    assert highest(found) == pytest.approx(TOP, abs=1e-3)
    assert any("the scan has a hole of 1" in note and "closed from its rim" in note for note in setup.notes)
    assert all(one.report.method is Method.COLUMNS and not one.report.problem for one in setup.geometry)


def test_a_wreck_of_a_scan_is_a_sound_solid():
    """No underside, a second layer 8 mm below, sheets inside, a tenth of the faces gone, a scrap in the air: the top is
    where it was, to the 8 mm of the second layer."""
    rng = np.random.default_rng(1)
    seen = where(SEAT, middles(SEAT)[:, 2] > 1e-6)
    kept = where(seen, rng.random(len(seen.faces)) > 0.1)
    top = where(seen, middles(seen)[:, 2] > TOP - 1e-6)
    layer = Mesh.of(top.vertices - np.array([0.0, 0.0, 0.008]), top.faces)
    inside = [scrap((x, y, 0.37)) for x in (-0.1, -0.05, 0.0, 0.05, 0.1) for y in (-0.1, -0.05, 0.05, 0.1)]
    setup, found = built(Mesh.concatenate([kept, layer, *inside, scrap((0.1, 0.1, TOP + 0.2))]))
    assert not [note for note in setup.notes if "valid solid" in note]
    assert highest(found) == pytest.approx(TOP, abs=0.0085)
    assert any("21 floating scraps" in note for note in setup.notes)


def test_a_good_scan_keeps_its_faces():
    """Nothing is mended, nothing is said."""
    setup, _ = built(SEAT)
    assert all(one.report.method is not Method.COLUMNS for one in setup.geometry)
    assert not [note for note in setup.notes if "scan" in note]
