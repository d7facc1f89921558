"""Splats rendered and meshed: one Gaussian against its formula, blending against numpy, a known room against itself."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from dcap.geometry.camera import Camera, looking_at
from dcap.geometry.distance import MeshDistance
from dcap.geometry.splatting.config import SurfaceConfig
from dcap.geometry.splatting.discs import FLATNESS, OVERLAP, splats_on_mesh
from dcap.geometry.splatting.kernels import BLUR
from dcap.geometry.splatting.render import Splatter
from dcap.geometry.splatting.surface import mesh_of_splats, surface_points
from dcap.geometry.splatting.visibility import best_origins
from dcap.scene.errors import GeometryError
from dcap.scene.types.gaussians import DC, Gaussians
from dcap.scene.types.mesh import Mesh
from dcap.synthetic.shapes import joined, moved, rounded_box
from solver.runtime import start


@pytest.fixture(autouse=True)
def taichi():
    """Kernels need it once per process."""
    start(2)


def gaussians(position, scale, color, opacity, rotation=None) -> Gaussians:
    """Gaussians of constant colour."""
    n = len(position)
    alpha = np.broadcast_to(opacity, n)
    quaternion = np.tile([1.0, 0, 0, 0], (n, 1)) if rotation is None else rotation
    return Gaussians(
        *(np.asarray(a, dtype=np.float32) for a in (
            position, np.log(np.broadcast_to(scale, (n, 3))), quaternion, np.log(alpha / (1 - alpha)),
            (np.asarray(color) - 0.5) / DC, np.zeros((n, 3, 0)),
        ))
    )  # fmt: skip


def ahead(width: int = 48, height: int = 32, focal: float = 60.0) -> Camera:
    """A camera at the origin that looks along x."""
    return Camera(
        np.zeros(3), np.array([1.0, 0, 0]), np.array([[0.0, 0, 1], [-1, 0, 0], [0, -1, 0]]), width, height, focal
    )


def test_one_gaussian_is_drawn_by_its_formula():
    """alpha exp(-d^T S^-1 d / 2), S = J R diag(s^2) R^T J^T + BLUR, J the derivative of the projection [Z01]."""
    place, scale = np.array([2.0, 0.1, -0.05]), np.array([0.1, 0.04, 0.02])
    turn = Rotation.from_euler("xyz", [0.4, -0.3, 0.8])
    splats = gaussians([place], scale, [[1.0, 0.5, 0.25]], 0.8, turn.as_quat(scalar_first=True)[None])
    camera = ahead()
    view = Splatter(splats).view(camera)
    x, y, z = camera.world_from_camera.T @ place
    J = camera.focal / z * np.array([[1, 0, -x / z], [0, 1, -y / z]])
    R = camera.world_from_camera.T @ turn.as_matrix()
    S = J @ R @ np.diag(scale**2) @ R.T @ J.T + BLUR * np.eye(2)
    rows, columns = np.mgrid[: camera.height, : camera.width]
    d = np.stack([columns + 0.5 - (24 + camera.focal * x / z), rows + 0.5 - (16 + camera.focal * y / z)], axis=-1)
    alpha = 0.8 * np.exp(-0.5 * np.einsum("rci,ij,rcj->rc", d, np.linalg.inv(S), d))
    alpha[alpha < 1 / 255] = 0.0
    close = np.abs(alpha - 1 / 255) < 1e-4  # where rounding decides whether it counts
    assert view.light[~close] == pytest.approx(1 - alpha[~close], abs=1e-5)
    assert view.image[~close] == pytest.approx(alpha[~close][:, None] * [1.0, 0.5, 0.25], abs=1e-5)
    assert view.weight == pytest.approx([alpha.max()], rel=1e-5)


def test_splats_cover_each_other_front_to_back():
    """Blended in numpy, pixel by pixel, from random splats larger than tiles; in any order of the input."""
    random = np.random.default_rng(0)
    n = 200
    place = random.uniform([1.0, -0.45, -0.3], [3, 0.45, 0.3], (n, 3))
    place[:, 1:] *= place[:, :1]  # in the picture: the derivative of what lies far outside is held
    splats = gaussians(place, random.uniform(0.02, 0.3, (n, 1)), random.uniform(0, 1, (n, 3)),
                       random.uniform(0.1, 0.9, n))  # fmt: skip
    camera = ahead()
    shuffled = random.permutation(n)
    view, other = (Splatter(s).view(camera, (0.2, 0.4, 0.6)) for s in (splats, splats.subset(shuffled)))
    assert np.array_equal(view.image, other.image)
    light, image = np.ones((32, 48)), np.zeros((32, 48, 3))
    rows, columns = np.mgrid[:32, :48]
    for g in np.argsort(place[:, 0]):
        x, y, z = camera.world_from_camera.T @ place[g]
        J = 60 / z * np.array([[1, 0, -x / z], [0, 1, -y / z]])
        S = J @ J.T * float(splats.scale[g, 0]) ** 2 + BLUR * np.eye(2)
        d = np.stack([columns + 0.5 - 24 - 60 * x / z, rows + 0.5 - 16 - 60 * y / z], axis=-1)
        alpha = np.minimum(0.99, splats.opacity[g] * np.exp(-0.5 * np.einsum("rci,ij,rcj->rc", d, np.linalg.inv(S), d)))
        alpha[(alpha < 1 / 255) | (light < 1e-3)] = 0.0
        image += (light * alpha)[:, :, None] * (DC * splats.dc[g] + 0.5)
        light *= 1 - alpha
    image += light[:, :, None] * [0.2, 0.4, 0.6]
    # a splat that rounding puts on the other side of 1/255 changes a pixel by as much
    assert view.image == pytest.approx(image, abs=1 / 255)
    assert np.abs(view.image - image).mean() < 1e-4


def inside_out(size: float) -> Mesh:
    """The inner faces of a cube of that size that stands on z = 0, with a box of 1 m on its floor."""
    cube = moved(rounded_box((size, size, size), 0.02, 0.1), z=size / 2)
    walls = Mesh.of(cube.vertices, cube.faces[:, ::-1], (180, 190, 200))
    return joined([walls, moved(rounded_box((1.0, 0.8, 0.5), 0.02, 0.05), x=0.3, y=0.2, z=0.25)])


def test_splats_lie_on_their_mesh_and_add_up_to_its_picture():
    """Centres on the surface, thin axes along its normals, evenly spread; from inside nothing shines through."""
    mesh = inside_out(3.0)
    splats = splats_on_mesh(mesh, 0.02, seed=0)
    assert len(splats) == pytest.approx(mesh.face_areas.sum() / 0.02**2, abs=1)
    assert np.abs(MeshDistance(mesh).unsigned(splats.position.astype(float))).max() < 1e-5
    face = MeshDistance(mesh).nearest_face(splats.position.astype(float))
    normal = mesh.face_normals[face] / np.linalg.norm(mesh.face_normals[face], axis=1, keepdims=True)
    flat = np.abs(np.einsum("ni,ni->n", normal, splats.axes[:, :, 2]))
    assert np.quantile(flat, 0.01) > 0.999  # next to an edge the nearest face may be the other one
    view = Splatter(splats).view(
        looking_at(np.array([-1.0, -1.0, 1.6]), np.array([0.3, 0.2, 0.3]), 120, 90, fov_deg=69.0)
    )
    # evenly spread they would add up to alpha 2 pi OVERLAP^2 / (1 m^2 / spacing^2) = 3.8 layers: exp(-3.8) = 0.02
    assert view.light.mean() < 0.03
    assert np.quantile(view.light, 0.99) < 0.15
    with pytest.raises(GeometryError, match="spacing of 1e-05 m"):
        splats_on_mesh(mesh, 1e-5, 0)


@pytest.mark.slow
def test_what_lies_under_a_layer_is_hidden():
    """Of a slab inside of a box, 3 cm under its top, hardly anything is seen, though light passes between splats; of
    the room around it, nearly everything but what the box stands on."""
    room, slab = inside_out(3.0), moved(rounded_box((0.8, 0.6, 0.2), 0.02, 0.05), x=0.3, y=0.2, z=0.37)
    splats = splats_on_mesh(joined([room, slab]), 0.02, seed=0)
    gap = np.full(len(splats), 0.02, dtype=np.float32)
    seen = np.isfinite(best_origins(Splatter(splats), gap, SurfaceConfig(places=6, pixels=160))[:, 0])
    inside = (np.abs(splats.position - [0.3, 0.2, 0.37]) < [0.42, 0.32, 0.11]).all(axis=1)
    under = (np.abs(splats.position - [0.3, 0.2, 0.0]) < [0.52, 0.42, 0.02]).all(axis=1)
    assert inside.sum() > 3000
    assert seen[inside].mean() < 0.05
    assert seen[~inside & ~under].mean() > 0.97


def ball(radius: float) -> Mesh:
    """A round mesh about the origin."""
    box = rounded_box((2 * radius,) * 3, 0.999 * radius, 0.05 * radius)
    return Mesh.of(radius * box.vertices / np.linalg.norm(box.vertices, axis=1, keepdims=True), box.faces)


@pytest.mark.parametrize("scatter", [0.0, 0.002])
def test_a_ball_of_splats_keeps_its_radius(scatter):
    """Discs on the tangents of a ball lie r^2 / 2R outside of it at the distance r from where they touch: on average
    s^2 / R for discs of the deviation s."""
    radius, spacing = 0.3, 0.01
    splats = splats_on_mesh(ball(radius), spacing, seed=0, scatter=scatter)
    points = surface_points(splats, SurfaceConfig(places=6, pixels=160))
    # the centres lie on flat faces, a little below the radius
    off = np.linalg.norm(points.position, axis=1) - np.linalg.norm(splats.position, axis=1).mean()
    thick = spacing * OVERLAP * FLATNESS
    assert off.mean() == pytest.approx((OVERLAP * spacing) ** 2 / radius, abs=0.05 * thick + 0.2 * scatter)
    assert off.std() < 0.4 * thick + 0.5 * scatter


def test_two_sides_of_a_board_of_2_cm_stay_two_surfaces():
    """No point of one side has the normal of the other; centres that scatter are halved by the neighbours they have."""
    board = rounded_box((0.5, 0.4, 0.02), 0.002, 0.05)
    scatter = 0.002
    points = surface_points(splats_on_mesh(board, 0.01, seed=0, scatter=scatter), SurfaceConfig(places=6, pixels=160))
    middle = (np.abs(points.position[:, :2]) < [0.22, 0.17]).all(axis=1)
    height, up = points.position[middle, 2], points.normal[middle, 2]
    assert (np.sign(height) == np.sign(up)).mean() > 0.999
    assert np.abs(np.abs(height) - 0.01).mean() < 0.5 * scatter


@pytest.mark.slow
@pytest.mark.long
def test_a_room_comes_back_from_its_splats():
    """Mesh to splats to mesh: within the offset of the level set and a fraction of a cell, and the same bytes twice."""
    mesh = inside_out(3.0)
    splats = splats_on_mesh(mesh, 0.03, seed=0)
    config = SurfaceConfig(places=6, pixels=128, cell=0.04, faces=60_000)
    found, again = (mesh_of_splats(splats, config, threads) for threads in (2, 1))
    assert np.array_equal(found.vertices, again.vertices)
    assert np.array_equal(found.faces, again.faces)
    # seen places lie on the mesh; the level set lies up to three deviations of a flat Gaussian before its centre
    seen = surface_points(splats, config).position
    offset = 3.0 * float(splats.scale[:, 2].mean())
    assert MeshDistance(found).unsigned(seen).mean() < 0.1 * config.cell
    away = MeshDistance(mesh).unsigned(found.vertices)
    assert away.mean() < offset
    assert np.quantile(away, 0.95) < offset + 0.25 * config.cell
