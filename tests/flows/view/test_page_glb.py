"""Surfaces as the page's GLB files: where they are, how they are lit, and what is on them."""

import io

import numpy as np
import pytest
from dented_bed import RADIUS, ball, box_mesh
from PIL import Image
from textured import plate, quarters

from dcap.geometry.rendering.painted import own_paint
from dcap.scene.types.mesh import AlphaMode, Mesh, Paint, PaintedMesh, SourceSurface, SurfaceMaterial
from flows.view.page_glb import ALBEDO, Document, PageSurface, glb_of, page_normals, parsed
from flows.view.surface import whole

Values = dict[str, np.ndarray]


def read(data: bytes) -> tuple[Document, list[Values]]:
    """The document, and of each primitive what its vertices have; `shading` is what the page makes of its normals."""
    document, blocks = parsed(data)

    def rows(accessor: int, kind: str) -> np.ndarray:
        entry = document["accessors"][accessor]
        return np.frombuffer(blocks[entry["bufferView"]], dtype=kind).reshape(entry["count"], -1)

    found = []
    for one in document["meshes"][0]["primitives"]:
        used = one["attributes"]
        points, faces = rows(used["POSITION"], "<f4"), rows(one["indices"], "<u4").reshape(-1, 3).astype(int)
        values = {"points": points, "faces": faces}
        values["shading"] = page_normals(points, faces)
        if "targets" in one:
            values["shading"] = values["shading"] + rows(one["targets"][0]["NORMAL"], "<f4")
        for key, name, kind in (("COLOR_0", "colors", "<u2"), ("TEXCOORD_0", "uv", "<f4")):
            if key in used:
                values[name] = rows(used[key], kind)
        found.append(values)
    return document, found


def seam() -> Mesh:
    """A ball of two halves that share no vertex."""
    mesh = ball().mesh
    upper = mesh.triangles.mean(axis=1)[:, 2] > 0.0
    return Mesh.concatenate([mesh.submesh(np.flatnonzero(upper)), mesh.submesh(np.flatnonzero(~upper))])


def test_normals_are_smooth_where_vertices_are_apart() -> None:
    """On a ball they point from its middle, at the border of its halves, too: 3 degrees off at most for 1280 faces."""
    _, (ball_,) = read(glb_of(whole(PaintedMesh(seam()))))
    assert np.einsum("ij,ij->i", ball_["shading"], ball_["points"] / RADIUS).min() > np.cos(np.radians(3.0))


def test_sharp_edges_stay() -> None:
    """Every normal of a box is along an axis."""
    _, (box,) = read(glb_of(whole(PaintedMesh(box_mesh((-1, -1, -1), (1, 1, 1))))))
    assert np.abs(box["shading"]).max(axis=1) == pytest.approx(1.0, abs=1e-6)


def test_the_axes_are_the_worlds_and_colours_are_linear() -> None:
    """z is up; half of the largest byte is about a fifth of the light (IEC 61966-2-1)."""
    _, (box,) = read(glb_of(whole(PaintedMesh(box_mesh((0, 0, 0), (1, 2, 3), (128, 0, 255))))))
    assert box["points"].max(axis=0).tolist() == [1.0, 2.0, 3.0]
    assert box["colors"][0].tolist() == pytest.approx(
        [65535 * ((128 / 255 + 0.055) / 1.055) ** 2.4, 0, 65535, 65535], abs=1
    )


def test_textures_and_their_coordinates_are_kept() -> None:
    """The image, and the corner that has its lower left pixel."""
    surface = plate()
    document, (one,) = read(glb_of(whole(PaintedMesh(surface.mesh, own_paint(surface)))))
    blocks = parsed(glb_of(whole(PaintedMesh(surface.mesh, own_paint(surface)))))[1]
    image = Image.open(io.BytesIO(blocks[document["images"][0]["bufferView"]]))
    assert (np.asarray(image) == quarters()).all()
    corner = np.flatnonzero((one["points"] == [-1.0, -1.0, 0.0]).all(axis=1))
    assert one["uv"][corner].tolist() == [[0.0, 1.0]]
    look = document["materials"][document["meshes"][0]["primitives"][0]["material"]]["pbrMetallicRoughness"]
    assert look["baseColorFactor"] == pytest.approx([ALBEDO, ALBEDO, ALBEDO, 1.0])


def test_a_surface_is_moved_without_being_written_anew() -> None:
    """The same faces elsewhere."""
    start = PaintedMesh(ball().mesh)
    page = PageSurface(whole(start))
    moved = start.mesh.transformed(np.array([[1.0, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 5], [0, 0, 0, 1]]))
    _, (one,) = read(page.glb(whole(start.moved(moved))))
    assert np.linalg.norm(one["points"] - [0, 0, 5], axis=1) == pytest.approx(RADIUS, abs=1e-6)


def test_colours_of_materials_and_their_transparency_are_kept() -> None:
    """A plate without a texture whose material is a half clear red, on a mesh of white vertices."""
    surface = plate()
    said = (SurfaceMaterial(alpha_mode=AlphaMode.BLEND, alpha=0.5), SurfaceMaterial())
    for number, factor in ((0, [ALBEDO, 0.0, 0.0, 0.5]), (1, [ALBEDO, ALBEDO, ALBEDO, 1.0])):
        paint = Paint(
            np.tile(np.array([255, 0, 0], dtype=np.uint8), (2, 1)), np.full(2, -1, np.int32), np.zeros((2, 3, 2)), (),
            face_material=np.full(2, number, np.int32), materials=said,
        )  # fmt: skip
        thing = PaintedMesh(surface.mesh, own_paint(SourceSurface(surface.mesh, paint)))
        document, (one,) = read(glb_of(whole(thing)))
        material = document["materials"][document["meshes"][0]["primitives"][0]["material"]]
        assert material["pbrMetallicRoughness"]["baseColorFactor"] == pytest.approx(factor)
        assert (material.get("alphaMode") == "BLEND") == (number == 0)
        if number == 1:  # a plain material's colour is its vertices'
            assert one["colors"][0].tolist() == [65535, 0, 0, 65535]
