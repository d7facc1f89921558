"""The rest state with the faces, texture coordinates and textures of the sources; and its contact patches."""

import json
import struct
from dataclasses import replace

import numpy as np
import pytest
import trimesh
from dented_bed import DEPTH, RADIUS, TOP, anchor, ball, scene_of, settled
from textured import plate, quarters

from dcap.geometry.rendering.painted import own_paint
from dcap.scene.readers.source import read_surface
from dcap.scene.types.mesh import Mesh, Paint, SourceSurface
from dcap.scene.writers.glb import Node, glb_bytes
from solver.certificate import ContactRow
from tasks.render.settled_meshes import contact_nodes, object_at_rest, scene_at_rest


def textured_scene() -> SourceSurface:
    """The scene's own faces, every one with the whole texture."""
    mesh = scene_of().mesh
    uv = np.tile(np.array([[0.0, 0.0], [1.0, 0.0], [1.0, 1.0]]), (len(mesh.faces), 1, 1))
    paint = Paint(np.full((len(mesh.faces), 3), 255, np.uint8), np.zeros(len(mesh.faces), np.int32), uv, (quarters(),))
    return SourceSurface(Mesh.of(mesh.vertices, mesh.faces, (255, 255, 255)), paint)


def textured_ball() -> SourceSurface:
    """The ball with a texture that runs along x and y."""
    mesh = ball().mesh
    uv = mesh.vertices[mesh.faces][..., :2] / (2 * RADIUS) + 0.5
    count = len(mesh.faces)
    paint = Paint(np.full((count, 3), 255, np.uint8), np.zeros(count, np.int32), uv, (quarters(),))
    return SourceSurface(Mesh.of(mesh.vertices, mesh.faces, (255, 255, 255)), paint)


def test_the_object_keeps_faces_and_coordinates_and_is_where_it_rests():
    source = textured_ball()
    found = object_at_rest(ball(), source, anchor(), settled().bodies[0])
    assert found.paint is not None
    assert np.array_equal(found.mesh.faces, source.mesh.faces)
    assert found.paint.corner_uv == pytest.approx(source.paint.corner_uv, abs=1e-6)
    assert found.mesh.vertices == pytest.approx(settled().bodies[0].surface.vertices, abs=1e-9)


def test_a_dented_support_is_cut_only_where_it_bends_and_keeps_its_coordinates():
    source = textured_scene()
    around, look = scene_at_rest(scene_of(), source, settled(), "bed")
    assert look.paint is not None
    assert (look.paint.texture == 0).all()
    counts = np.bincount(around.origin, minlength=len(source.mesh.faces))
    top = (source.mesh.face_normals[:, 2] > 0) & (source.mesh.triangles[:, :, 2].min(axis=1) > TOP - 1e-6)
    top &= source.mesh.triangles[:, :, 2].max(axis=1) < TOP + 1e-6
    assert (counts[top] > 100).all()
    assert counts[12:].max() == 1  # floor and walls are as they were
    inner = np.linalg.norm(around.scene.mesh.vertices[:, :2], axis=1) < 0.01
    assert around.scene.mesh.vertices[inner & (around.shift[:, 2] < 0), 2].min() == pytest.approx(TOP - DEPTH, abs=1e-3)
    # the same place of the texture at the same place of the undeformed surface
    face = np.flatnonzero(top)[0]
    mine = np.flatnonzero(around.origin == face)
    corner = around.start.triangles[mine]
    triangle, uv = source.mesh.triangles[face], source.paint.corner_uv[face]
    map_to_uv = np.linalg.lstsq(np.column_stack([triangle[:, :2], np.ones(3)]), uv, rcond=None)[0]
    expected = np.concatenate([corner[..., :2], np.ones((*corner.shape[:2], 1))], axis=2) @ map_to_uv
    assert np.abs(expected - look.paint.corner_uv[mine]).max() < 1e-5


def test_a_written_file_has_the_textures_and_is_read_back(tmp_path):
    """trimesh and our own reader find the same faces, coordinates and picture."""
    source = textured_ball()
    thing = object_at_rest(ball(), source, anchor(), settled().bodies[0])
    normals = np.asarray(trimesh.Trimesh(thing.mesh.vertices, thing.mesh.faces).face_normals, dtype=np.float32)
    corner_normals = np.repeat(normals[:, None], 3, axis=1)
    path = tmp_path / "object.glb"
    path.write_bytes(glb_bytes([Node("object", thing.mesh, paint=thing.paint, normals=corner_normals)]))
    again = read_surface(path, np.eye(4))
    assert again.textured
    assert np.array_equal(again.paint.textures[0], quarters())
    assert len(again.mesh.faces) == len(source.mesh.faces)
    corners = lambda surface: np.concatenate(  # noqa: E731
        [surface.mesh.triangles.reshape(-1, 3), surface.paint.corner_uv.reshape(-1, 2)], axis=1
    )
    y_up = thing.mesh.vertices[:, [0, 2, 1]] * [1, 1, -1]
    mine = corners(SourceSurface(Mesh.of(y_up, source.mesh.faces), source.paint))
    order = lambda rows: rows[np.lexsort(np.round(rows, 4).T)]  # noqa: E731
    assert order(corners(again)) == pytest.approx(order(mine), abs=2e-4)
    loaded = trimesh.load(path)
    geometry = next(iter(loaded.geometry.values()))  # type: ignore[attr-defined]
    assert len(geometry.faces) == len(source.mesh.faces)
    assert np.asarray(geometry.visual.material.baseColorTexture).shape == (64, 64, 3)


@pytest.mark.parametrize("wrap", [("repeat", "mirror"), ("clamp", "repeat")])
def test_how_a_texture_goes_on_is_kept(tmp_path, wrap):
    """Two nodes with the same picture and another mode: one image, two textures; read back as written."""
    one = plate()
    other = SourceSurface(one.mesh, replace(one.paint, wraps=(wrap,)))
    path = tmp_path / "plates.glb"
    nodes = [Node(name, each.mesh, paint=own_paint(each)) for name, each in (("one", one), ("other", other))]
    data = glb_bytes(nodes)
    path.write_bytes(data)
    document = document_of(data)
    assert (len(document["images"]), len(document["textures"]), len(document["samplers"])) == (1, 2, 2)
    again = read_surface(path, np.eye(4)).paint
    assert again.wraps == (("repeat", "repeat"), wrap)
    assert [len(np.flatnonzero(again.face_texture == slot)) for slot in (0, 1)] == [2, 2]


def document_of(data):
    length = struct.unpack("<I", data[12:16])[0]
    return json.loads(data[20 : 20 + length])


def test_contact_patches_carry_their_loads():
    """The ball's patch is a cap of the sphere, of the area that was found, around its lowest point."""
    area = 2.0 * np.pi * RADIUS * 0.027
    row = ContactRow(a="object", b="bed", area_m2=area, normal_force_n=9.81, tangential_force_n=0.0,
                     max_penetration_m=0.0, max_gap_m=0.0, points=10)  # fmt: skip
    (root,) = contact_nodes(replace(settled(), contacts=(row,)))
    (patch,) = root.children
    assert patch.name == "object on bed"
    assert patch.extras["mean_pressure_pa"] == pytest.approx(9.81 / area)
    assert patch.mesh is not None
    assert patch.mesh.face_areas.sum() == pytest.approx(area, rel=0.02)
    low = settled().bodies[0].surface.bounds[0, 2]
    # a cap of area 2 pi R h is h high; the points that it follows are 15 mm apart
    assert patch.mesh.vertices[:, 2].max() - low == pytest.approx(0.027, abs=1e-2)
