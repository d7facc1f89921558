"""Surfaces of point clouds: near the true surface, the right side out, closed where points lie all around."""

import numpy as np
import pytest
import trimesh
from mesh_files import volume
from numpy.typing import NDArray
from point_files import points_on, without_normals

from dcap.geometry.distance import MeshDistance
from dcap.geometry.raycast import Raycaster
from dcap.geometry.splatting.cloud import is_room, mesh_of_points, without_strays
from dcap.geometry.splatting.config import SurfaceConfig
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.point_cloud import PointCloud, local_planes
from dcap.synthetic.dataset import build_object
from dcap.synthetic.rooms import build_room
from solver.runtime import start

FEW_VIEWS = SurfaceConfig(places=6, pixels=240)
"""Enough for what is small."""


def mug() -> Mesh:
    """The embedded mug, whose recipe is in centimetres, in metres."""
    whole = Mesh.concatenate([solid for part in build_object("mug").parts for solid in part.solids])
    return whole.transformed(np.diag([0.01, 0.01, 0.01, 1.0]))


def seen_from_the_middle(mesh: Mesh, cloud: PointCloud) -> NDArray[np.bool_]:
    """Points that somebody sees who stands at one of five places of a room, shape (n,)."""
    low, high = mesh.bounds
    caster, seen = Raycaster(mesh), np.zeros(len(cloud), dtype=bool)
    for x, y in ((0.5, 0.5), (0.3, 0.3), (0.3, 0.7), (0.7, 0.3), (0.7, 0.7)):
        eye = low + (high - low) * np.array([x, y, 0.65])
        way = eye - cloud.position
        distance = np.linalg.norm(way, axis=1)
        way /= distance[:, None]
        assert cloud.normal is not None
        front = np.einsum("ni,ni->n", way, cloud.normal) > 0.05
        hit = caster.cast(cloud.position + 1e-3 * cloud.normal, way).distance
        seen |= front & (hit > distance - 0.01)
    return seen


@pytest.mark.slow
@pytest.mark.parametrize("normals", ["none", "given", "inside out", "of either sign"])
def test_a_mug_becomes_a_closed_mesh_with_its_outside_out(normals: str) -> None:
    """Its wall of millimetres keeps two sides, its volume is right, whatever the file says of normals."""
    start()
    true = mug()
    cloud = points_on(true, 20_000, noise=5e-5)
    assert cloud.normal is not None
    sign = {"given": 1.0, "inside out": -1.0, "none": 1.0}.get(normals)
    flips = np.random.default_rng(1).choice([-1.0, 1.0], (len(cloud), 1)) if sign is None else sign
    given = None if normals == "none" else flips * cloud.normal
    mesh, notes = mesh_of_points(PointCloud(cloud.position, cloud.color, given), FEW_VIEWS, single=True)
    assert trimesh.Trimesh(mesh.vertices, mesh.faces, process=False).is_watertight
    # 20,000 points on 0.05 m^2 lie 1.6 mm apart: a surface within a tenth of that moves the volume of a wall of 4 mm,
    # which has two sides, by twice 0.16 / 4
    assert volume(mesh) == pytest.approx(volume(true), rel=0.08)
    away = MeshDistance(true).unsigned(mesh.vertices)
    assert away.mean() < 1.6e-4
    assert np.quantile(away, 0.99) < 1.6e-3
    told = " ".join(notes)
    assert {"none": "no normals in the file", "given": "normals are used", "inside out": "reversed",
            "of either sign": "point both ways"}[normals] in told  # fmt: skip


@pytest.mark.long
def test_a_room_is_seen_from_inside() -> None:
    """Points that can be seen become a surface as near as they are apart, whose faces look into the room."""
    start()
    true = build_room("bedroom_01", 0).record.mesh
    cloud = points_on(true, 400_000, noise=0.002)
    seen = cloud.subset(seen_from_the_middle(true, cloud))
    assert is_room(seen)
    mesh, notes = mesh_of_points(without_normals(seen), SurfaceConfig(), single=False)
    gap = float(np.median(local_planes(seen.position[:50_000]).gap))
    assert MeshDistance(mesh).unsigned(seen.position).mean() < 0.004  # twice their own noise
    assert np.quantile(MeshDistance(true).unsigned(mesh.vertices), 0.95) < 2.0 * gap
    low, high = mesh.bounds
    floor = np.abs(mesh.triangles[:, :, 2].mean(axis=1) - low[2]) < 0.03
    up = mesh.face_normals[:, 2]
    assert up[floor].sum() > 0.95 * np.abs(up[floor]).sum()
    ceiling = np.abs(mesh.triangles[:, :, 2].mean(axis=1) - high[2]) < 0.03
    assert up[ceiling].sum() < -0.95 * np.abs(up[ceiling]).sum()
    assert any("towards the inside of the room" in note for note in notes)


def test_strays_go_and_are_counted() -> None:
    """Points metres away from a box leave it as it was."""
    cloud = points_on(Mesh.of(*box((0.4, 0.3, 0.2))), 5000)
    far = np.random.default_rng(0).uniform(2.0, 5.0, (7, 3))
    more = PointCloud(np.vstack([cloud.position, far]), np.vstack([cloud.color, np.zeros((7, 3), np.uint8)]))
    kept, notes = without_strays(more, threads=1)
    assert len(kept) == 5000
    assert "7 points" in notes[0]


def box(size: tuple[float, float, float]) -> tuple[NDArray[np.float64], NDArray[np.int64]]:
    """Corners and faces of a box about the origin."""
    solid = trimesh.creation.box(size)
    return np.asarray(solid.vertices), np.asarray(solid.faces)
