"""What stands around the base as fixed rigid bodies."""

from dataclasses import replace

import numpy as np
import pytest
from benches import FOAM, WOOD, cube_over
from box_rooms import Things, block, segmentation

from dcap.geometry.distance import sampler
from dcap.scene.types.choices import Lean
from dcap.scene.types.materials import BodyModel, Material, PartMaterial, PartMaterials
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.particles import RigidSimulationBody
from tasks.particles.base_bodies import base_bodies
from tasks.particles.contact_layers import footprint_on
from tasks.particles.drop_setup import DropSetup
from tasks.particles.obstacles import SLAB, neighbours, wall_slab

SEAT = block((-0.6, -0.4, 0.0), (0.6, 0.4, 0.45))
RUBBER = replace(WOOD, id="rubber", static_friction=0.9, dynamic_friction=0.8, rolling_resistance=0.01)


def cube_by_a_shelf(lower: Material, upper: Material) -> DropSetup:
    """A cube over a bench, beside a shelf whose upper half is another part than its lower, of materials of their own;
    the object may touch both."""
    setup = cube_over([("seat", SEAT, FOAM)], 0.45)
    shelf = [
        ("foot", block((0.08, -0.1, 0.46), (0.2, 0.1, 0.5))),
        ("board", block((0.08, -0.1, 0.5), (0.2, 0.1, 0.54))),
    ]
    setup.scene = segmentation({"bench_0": ("bench", None, [("seat", SEAT)]), "shelf_1": ("shelf", None, shelf)})
    rows = [
        PartMaterial("shelf_1", name, index, material, BodyModel.RIGID, "test")
        for index, (name, material) in enumerate((("foot", lower), ("board", upper)))
    ]
    setup.materials = PartMaterials((*setup.materials.rows, *rows), "none")
    return setup


def around(setup: DropSetup) -> list[RigidSimulationBody]:
    """All obstacles."""
    return neighbours(setup, footprint_on(setup, []))


def shelf_of(setup: DropSetup) -> RigidSimulationBody:
    """The one obstacle."""
    (body,) = around(setup)
    return body


def test_each_part_of_a_neighbour_has_its_own_friction() -> None:
    """Where the object may touch a shelf's rubber feet it finds rubber, at its board wood."""
    body = shelf_of(cube_by_a_shelf(RUBBER, WOOD))
    height = body.surface.triangles.mean(axis=1)[:, 2]
    assert body.face_friction is not None
    for where, one in ((height < 0.499, RUBBER), (height > 0.501, WOOD)):
        expected = [one.static_friction, one.dynamic_friction, one.rolling_resistance]
        assert where.any()
        assert np.abs(body.face_friction[where] - expected).max() == pytest.approx(0.0, abs=1e-12)


def cube_by_a_wall(lean: str) -> DropSetup:
    """A cube over a bench, beside a thin wall whose face is at x = 0.06 and on which a socket stands out by 5 mm."""
    setup = cube_over([("seat", SEAT, FOAM)], 0.45)
    wall = Mesh.concatenate(
        [block((0.06, -1.0, 0.0), (0.061, 1.0, 2.0)), block((0.055, 0.03, 0.5), (0.06, 0.035, 0.505))]
    )
    things: Things = {
        "bench_0": ("bench", None, [("seat", SEAT)]), "wall_0": ("wall", None, [("wall", wall)]),
    }  # fmt: skip
    setup.scene = segmentation(things)
    setup.anchor = replace(setup.anchor, lean=Lean(lean, 0.2, np.array([0.2, 0.0, 0.98])) if lean else None)
    return setup


def test_a_wall_takes_part_only_where_something_leans_on_it() -> None:
    """Else walls are left out, as nothing touches them."""
    assert around(cube_by_a_wall("")) == []
    assert [body.name for body in around(cube_by_a_wall("wall_0"))] == ["wall_0"]


def test_a_wall_is_a_block_behind_its_face() -> None:
    """Its skin is at x = 0.06: before it the distance is positive, 2 cm behind it -2 cm, whatever stands out of it."""
    (wall,) = around(cube_by_a_wall("wall_0"))
    slab = wall_slab(cube_by_a_wall("wall_0"), cube_by_a_wall("wall_0").scene.instances[1], np.arange(12, 36))
    assert slab.bounds[0, 0] == pytest.approx(0.06, abs=2e-3)
    assert slab.bounds[1, 0] == pytest.approx(0.06 + SLAB, abs=2e-3)
    assert wall.fixed


TOP = 0.45


@pytest.mark.parametrize("thickness", [5e-5, pytest.param(2e-3, marks=pytest.mark.long)])
def test_a_board_thinner_than_samples_carries_at_its_upper_side(thickness: float) -> None:
    """A plane is reproduced exactly by interpolation, so the distance is the height over the upper side, also where
    samples are 50 times as far apart as the two sides."""
    board = block((-0.5, -0.3, TOP - thickness), (0.5, 0.3, TOP))
    rigid = base_bodies(cube_over([("top", board, WOOD)], TOP)).rigid
    assert rigid is not None
    assert rigid.distance.spacing > thickness
    for height in (-1e-3, 0.0, 1e-3):
        points = np.array([[0.0, 0.0, TOP + height], [0.031, -0.017, TOP + height], [-0.12, 0.08, TOP + height]])
        # single precision at distances of a metre
        assert sampler(rigid.distance)(points) == pytest.approx(np.full(3, height), abs=2e-6)


def test_a_thin_bowl_carries_on_its_inside() -> None:
    """Half a hollow sphere of 0.2 mm: what lies within is outside of it, what lies between its skins or under it is
    inside."""
    import trimesh

    sphere = trimesh.creation.icosphere(4, 0.2)
    half = sphere.slice_plane([0.0, 0.0, 0.0], [0.0, 0.0, -1.0])
    outer, inner = Mesh.of(half.vertices, half.faces), Mesh.of(half.vertices * 0.999, half.faces[:, ::-1])
    bowl = Mesh.concatenate([outer, inner]).transformed(
        np.array([[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0.65], [0, 0, 0, 1.0]])
    )
    rigid = base_bodies(cube_over([("bowl", bowl, WOOD)], TOP)).rigid
    assert rigid is not None
    side = np.array([np.sin(0.6), 0.0, -np.cos(0.6)])
    middle = np.array([0.0, 0.0, 0.65])
    distance = sampler(rigid.distance)(
        middle + np.array([[0.0, 0.0, -0.195], 0.195 * side, [0, 0, -0.202], 0.202 * side])
    )
    assert (distance[:2] > 2e-3).all()
    assert (distance[2:] < -1e-3).all()
