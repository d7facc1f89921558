"""Objects set down on random supports: one centimetre over what lies beneath, and in nothing."""

from dataclasses import dataclass

import numpy as np
import pytest
import trimesh

from dcap.geometry.distance import MeshDistance
from dcap.geometry.placement.clearance import Clearance, Start, set_down
from dcap.geometry.placement.named_regions import Region
from dcap.geometry.placement.search import PlacementSearch
from dcap.geometry.raycast import Raycaster
from dcap.scene.types.mesh import Mesh

GAP = 0.01
WIDE, DEEP = 1.2, 0.9
SQUARE = np.array([[-WIDE, -DEEP], [WIDE, -DEEP], [WIDE, DEEP], [-WIDE, DEEP]]) / 2.0


def as_mesh(shape: trimesh.Trimesh, x: float = 0.0, y: float = 0.0, z: float = 0.0) -> Mesh:
    return Mesh.of(shape.vertices + np.array([x, y, z]), shape.faces)


def block(low: tuple[float, float, float], high: tuple[float, float, float]) -> Mesh:
    return as_mesh(trimesh.creation.box(bounds=[low, high]))


def rod(radius: float, low: float, high: float, x: float, y: float) -> Mesh:
    shape = trimesh.creation.cylinder(radius=radius, height=high - low, sections=12)
    return as_mesh(shape, x, y, (low + high) / 2)


def ball(radius: float, x: float = 0.0, y: float = 0.0, z: float = 0.0, flat: float = 1.0) -> Mesh:
    shape = trimesh.creation.icosphere(subdivisions=3, radius=radius)
    shape.vertices *= (1.0, 1.0, flat)
    return as_mesh(shape, x, y, z)


def stool() -> list[Mesh]:
    """A seat on four legs, 30 cm high: hollow underneath."""
    legs = [block((x - 0.02, y - 0.02, 0.0), (x + 0.02, y + 0.02, 0.27)) for x in (-0.15, 0.15) for y in (-0.15, 0.15)]
    return [block((-0.18, -0.18, 0.27), (0.18, 0.18, 0.3)), *legs]


@dataclass(frozen=True, eq=False, slots=True)
class Scene:
    """A support with what is on and over it."""

    mesh: Mesh
    support: np.ndarray

    def start(self, item: Mesh, aim: tuple[float, float] = (0.0, 0.0), polygon: np.ndarray = SQUARE) -> Start | None:
        caster = Raycaster(self.mesh)
        search = PlacementSearch(self.mesh, caster, self.support, item)
        return set_down(search, Clearance(item, self.mesh, caster), [Region(polygon, np.array(aim))], GAP)


def scene_of(support: Mesh, others: list[Mesh]) -> Scene:
    mesh = Mesh.concatenate([support, *others])
    return Scene(mesh, np.arange(len(mesh.faces)) < len(support.faces))


def moved(mesh: Mesh, start: Start) -> Mesh:
    pose = np.eye(4)
    pose[:3, 3] = start.spot.x, start.spot.y, start.height
    return mesh.transformed(pose)


def surface_points(mesh: Mesh, spacing: float) -> np.ndarray:
    """Points on all faces, no two further apart than the spacing [m]."""
    vertices, _ = trimesh.remesh.subdivide_to_size(mesh.vertices, mesh.faces, spacing, max_iter=20)
    return np.asarray(vertices)


def depth(points: np.ndarray, solids: list[Mesh]) -> float:
    """How far the deepest point lies in one of the closed solids [m]; negative: outside of all."""
    return max((float(-MeshDistance(solid)(points).min()) for solid in solids), default=-np.inf)


def test_two_edges_that_cross_count():
    """A bar across a roof's ridge touches it between all vertices of both: still 1 cm, though both are coarse."""
    roof = Mesh.of(
        np.array([[-0.3, -0.1, 0], [0.3, -0.1, 0], [0.3, 0.1, 0], [-0.3, 0.1, 0], [-0.3, 0, 0.05], [0.3, 0, 0.11]]),
        np.array([[0, 1, 5], [0, 5, 4], [2, 3, 4], [2, 4, 5], [1, 2, 5], [3, 0, 4], [0, 3, 2], [0, 2, 1]]),
    )
    bar = block((-0.02, -0.1, -0.01), (0.02, 0.1, 0.01))
    scene = scene_of(roof, [])
    start = scene.start(bar)
    assert start is not None
    # the ridge climbs 0.06 in 0.6 m: under the bar's higher long edge it is at 0.08 + 0.1 x
    ridge = 0.08 + 0.1 * (start.spot.x + 0.02)
    assert start.height - 0.01 - ridge == pytest.approx(GAP, abs=1e-4)


def test_thin_rods_between_the_samples_are_not_cut():
    """A plate of 60 cm on a table with a forest of wires of 2 mm: rays 2 cm apart miss them, the plate does not."""
    rng = np.random.default_rng(3)
    wires = [rod(0.001, -0.01, 0.2, x, y) for x, y in rng.uniform((-0.6, -0.4), (0.1, 0.4), (12, 2))]
    scene = scene_of(block((-0.8, -0.45, -0.03), (0.8, 0.45, 0.0)), wires)
    polygon = np.array([[-0.8, -0.45], [0.8, -0.45], [0.8, 0.45], [-0.8, 0.45]])
    plate = block((-0.3, -0.3, -0.01), (0.3, 0.3, 0.01))
    start = scene.start(plate, (-0.3, 0.0), polygon)
    assert start is not None
    assert depth(surface_points(moved(plate, start), 0.02), wires) < 0
    assert all(depth(wire.vertices, [moved(plate, start)]) < 0 for wire in wires)


def test_an_upright_sheet_is_in_the_way():
    """Rays along gravity never meet a wall without thickness; a ball aimed at its foot stays on one side of it."""
    wall = Mesh.of(np.array([[-1.0, 0.1, -0.1], [1, 0.1, -0.1], [1, 0.1, 1], [-1, 0.1, 1]]), [[0, 1, 2], [0, 2, 3]])
    scene = scene_of(block((-0.6, -0.45, -0.03), (0.6, 0.45, 0.0)), [wall])
    start = scene.start(ball(0.1), (0.0, 0.1))
    assert start is not None
    assert abs(start.spot.y - 0.1) >= 0.1
    assert np.hypot(start.spot.x, start.spot.y - 0.1) < 0.12


def test_a_stool_stands_over_a_pillow():
    """What is lower than the seat may lie between the legs; only the stool's middle has to be over the support."""
    scene = scene_of(block((-0.6, -0.45, -0.1), (0.6, 0.45, 0.0)), [ball(0.1, 0.0, 0.0, 0.02, flat=0.5)])
    start = scene.start(Mesh.concatenate(stool()))
    assert start is not None
    assert np.hypot(start.spot.x, start.spot.y) < 0.12
    assert start.height == pytest.approx(GAP, abs=1e-4)
