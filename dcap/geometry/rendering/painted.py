"""Meshes with textures, as met by rays, which pass where a texture is clear.

In: a mesh whose faces are, or are parts of, the faces of a textured surface. Out: its paint, corner by corner, and
colours where rays meet it. A texture seen from far away is read from a smaller copy whose pixels are as large as the
picture's [W83].

[W83] Williams: Pyramidal parametrics. Computer Graphics (SIGGRAPH) 17(3), 1983.

Rays that pass where the texture of a face is transparent: leaves, lace, panes of a lantern.

In: meshes with textures. Out: a common ray caster, the plain one if no texture is transparent. Every pass of a picture
uses the same caster, so that colour, depth, ids and shadows agree. A texel is either present or absent: for `MASK` by
its cutoff, for `BLEND` from an alpha of one half. A factor that makes a whole blended material transparent does not
count, nor does the alpha of a material of which hardly anything would remain: glass is drawn.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dcap.arrays import Float32Array
from dcap.geometry.raycast import Packed, PackedHits, Raycaster, tensor
from dcap.scene.srgb import LINEAR, Wrap, sampled, srgb_from_linear, texels
from dcap.scene.types.mesh import AlphaMode, CornerPaint, Mesh, PaintedMesh, SourceSurface, SurfaceMaterial

HALF = 0.5
"""Least alpha of a present blended texel [-]."""
LEAST_LEFT = 0.05
"""Least present share of the area of a material that is not glass [-]."""
MOST_LAYERS = 64
"""Maximum number of transparent faces that a ray passes; the next one stops it."""
STEP = (2e-5, 1e-6)
"""Distance behind a transparent face at which a ray continues: a share of the distance to it, and a constant [m]."""
INSIDE = np.array([[1, 1, 1], [4, 1, 1], [1, 4, 1], [1, 1, 4], [2, 2, 1], [2, 1, 2], [1, 2, 2]], dtype=np.float64)
INSIDE = INSIDE / INSIDE.sum(axis=1, keepdims=True)
"""Barycentric coordinates at which a face's alpha is sampled to detect glass, shape (7, 3)."""

OUTSIDE = 0.05
"""Largest distance of a corner outside its face, in barycentric coordinates [-]."""
NEAR = 1e-4
"""Largest distance of a face's middle from its textured surface, over the surface's extent [-]."""


def least_alpha(said: SurfaceMaterial) -> float:
    """Least alpha of the present texels of a texture; 0: all are present."""
    if said.alpha_mode is AlphaMode.MASK:
        return said.alpha_cutoff / said.alpha if said.alpha > 0.0 else 0.0
    return HALF if said.alpha_mode is AlphaMode.BLEND else 0.0


def cut_out(source: SourceSurface) -> NDArray[np.bool_]:
    """Mask of the faces of a surface that rays pass where their texture is transparent, shape (m,)."""
    paint, area = source.paint, None
    found = np.zeros(len(paint.face_texture), dtype=bool)
    for slot, image in enumerate(paint.textures):
        if image.shape[2] == 3:
            continue
        for number, said in enumerate(paint.materials):
            mine = np.flatnonzero((paint.face_texture == slot) & (paint.material_index == number))
            if not len(mine) or least_alpha(said) <= 0.0:
                continue
            area = source.mesh.face_areas if area is None else area
            uv = np.einsum("kc,mci->mki", INSIDE, paint.corner_uv[mine])
            there = (alpha_at(image, uv, paint.wrap(slot)) >= least_alpha(said)).mean(axis=1)
            found[mine] = (there * area[mine]).sum() >= LEAST_LEFT * area[mine].sum()
    return found


def alpha_at(image: NDArray[np.uint8], uv: NDArray[np.floating], wrap: Wrap) -> NDArray[np.float64]:
    """Bilinear samples 0..1 of an image's alpha (h, w, 4) at texture coordinates (..., 2), shape (...)."""
    height, width = image.shape[:2]
    left, right, fx = texels(uv[..., 0], width, wrap[0])
    low, high, fy = texels(1.0 - uv[..., 1], height, wrap[1])
    alpha, x, y = image[..., 3], fx[..., 0], fy[..., 0]
    top = alpha[low, left] * (1 - x) + alpha[low, right] * x
    bottom = alpha[high, left] * (1 - x) + alpha[high, right] * x
    return np.asarray((top * (1 - y) + bottom * y) / 255.0)


def caster_of(
    things: Sequence[PaintedMesh], joined: Mesh | None = None, faces: NDArray[np.integer] | None = None
) -> Raycaster:
    """A ray caster of several meshes, with faces in their order: of all of them, or of some (k,), which keep their
    indices; `joined` are the meshes in one, if already available."""
    mesh = Mesh.concatenate([one.mesh for one in things]) if joined is None else joined
    if not any(one.paint is not None and one.paint.cut_out.any() for one in things):
        return Raycaster(mesh, faces)
    return SeeThroughCaster(mesh, things, faces)


class SeeThroughCaster(Raycaster):
    """A mesh with transparent places, prepared for many rays."""

    def __init__(self, mesh: Mesh, things: Sequence[PaintedMesh], faces: NDArray[np.integer] | None = None) -> None:
        super().__init__(mesh, faces)
        self._paints = [one.paint for one in things]
        self._first = np.cumsum([0, *(len(one.mesh.faces) for one in things)])
        plain = [
            np.zeros(len(one.mesh.faces), dtype=bool) if one.paint is None else one.paint.cut_out for one in things
        ]
        self._cut_out = np.concatenate(plain)

    def first_hits(self, packed: Packed) -> PackedHits:
        """First hits of rays, ignoring places that are cut out."""
        found = super().first_hits(packed)
        going = np.flatnonzero(self._clear(found))
        if not len(going):
            return found
        distance, face = found.distance.copy(), found.face.copy()
        normal, uv = found.normal.copy(), found.uv.copy()
        length = np.linalg.norm(packed[going, 3:], axis=1)
        passed = np.zeros(len(packed), dtype=np.float32)
        for _ in range(MOST_LAYERS):
            passed[going] = distance[going] * (1 + STEP[0]) + STEP[1] / length
            rays = packed[going]
            rays[:, :3] += passed[going, None] * rays[:, 3:]
            behind = super().first_hits(rays)
            distance[going], face[going] = behind.distance + passed[going], behind.face
            normal[going], uv[going] = behind.normal, behind.uv
            more = self._clear(behind)
            going, length = going[more], length[more]
            if not len(going):
                break
        return PackedHits(distance, face, normal, uv)

    def blocked(self, packed: Packed) -> NDArray[np.bool_]:
        """Mask of the rays that hit anything present within the length of their direction."""
        stopped = super().blocked(packed)
        some = np.flatnonzero(stopped)
        if len(some):
            stopped[some] = self.first_hits(packed[some]).distance <= 1.0
        return stopped

    def _clear(self, hits: PackedHits) -> NDArray[np.bool_]:
        """Mask of the hits at absent places."""
        clear = np.zeros(len(hits.face), dtype=bool)
        asked = np.flatnonzero((hits.face >= 0) & self._cut_out[hits.face])
        owner = np.searchsorted(self._first, hits.face[asked], side="right") - 1
        for thing in np.unique(owner).tolist():
            mine, paint = asked[owner == thing], self._paints[thing]
            assert paint is not None
            face = hits.face[mine] - self._first[thing]
            u, v = hits.uv[mine].astype(np.float64).T
            weights = np.stack([1.0 - u - v, u, v], axis=1)
            clear[mine] = alphas(paint, face, weights) < 0.0
        return clear


def alphas(paint: CornerPaint, face: NDArray[np.integer], weights: NDArray[np.float64]) -> NDArray[np.float64]:
    """Alpha of the textures at places of faces (n,), given by the weights of their corners (n, 3), minus the least
    alpha of a present texel, shape (n,)."""
    uv = np.einsum("nk,nki->ni", weights, paint.corner_uv[face])
    kinds, kind_of = np.unique(
        np.stack([paint.texture[face], paint.material[face]], axis=1), axis=0, return_inverse=True
    )
    found = np.empty(len(face))
    for kind, (slot, material) in enumerate(kinds.tolist()):
        mine = kind_of.reshape(-1) == kind
        own = alpha_at(paint.textures[slot], uv[mine], paint.wrap(slot))
        found[mine] = own - least_alpha(paint.materials[material])
    return found


def painted(mesh: Mesh, source: SourceSurface | None) -> PaintedMesh:
    """A mesh made of faces of a surface, or parts of them, with the surface's textures."""
    if source is None or not source.textured:
        return PaintedMesh(mesh)
    return PaintedMesh(mesh, paint_from(source, mesh, nearest_faces(source.mesh, mesh)))


def nearest_faces(surface: Mesh, mesh: Mesh) -> NDArray[np.int64]:
    """The face of a surface nearest to the middle of each face of a mesh, -1 where none is close, shape (m,).

    If faces coincide, as where one thing stands on another, the one with the same direction is taken.
    """
    middle, found = mesh.triangles.mean(axis=1), np.full(len(mesh.faces), -1)
    mine, theirs = sides(mesh), sides(surface)
    for side in np.unique(mine):
        asked, known = np.flatnonzero(mine == side), np.flatnonzero(theirs == side)
        if len(known):
            found[asked] = nearest(surface, known, middle[asked])
    lost = np.flatnonzero(found < 0)
    if len(lost):
        found[lost] = nearest(surface, np.arange(len(surface.faces)), middle[lost])
    return found


def sides(mesh: Mesh) -> NDArray[np.int64]:
    """Index of the one of six axes nearest to each face's normal, shape (m,)."""
    normal = mesh.face_normals
    axis = np.abs(normal).argmax(axis=1)
    return np.asarray(2 * axis + (normal[np.arange(len(normal)), axis] < 0.0))


def nearest(surface: Mesh, faces: NDArray[np.int64], points: NDArray[np.float64]) -> NDArray[np.int64]:
    """The nearest of some faces of a surface to each point (n, 3), -1 if none is close, shape (n,)."""
    import open3d

    shift = surface.bounds.mean(axis=0)
    scene = open3d.t.geometry.RaycastingScene()
    scene.add_triangles(tensor(surface.vertices - shift, np.float32), tensor(surface.faces[faces], np.uint32))
    found = scene.compute_closest_points(tensor(points - shift, np.float32))
    away = np.linalg.norm(found["points"].numpy() + shift - points, axis=1)
    close = away <= NEAR * float(np.ptp(surface.bounds, axis=0).max())
    return np.where(close, faces[found["primitive_ids"].numpy().astype(np.int64)], -1)


def paint_from(source: SourceSurface, mesh: Mesh, owner: NDArray[np.int64]) -> CornerPaint:
    """Paint of a mesh whose faces lie in the faces `owner` (m,) of a surface; -1: in none."""
    face = np.maximum(owner, 0)
    weights = barycentric(mesh.triangles, source.mesh.triangles[face])
    inside = np.isfinite(weights).all(axis=(1, 2)) & (weights > -OUTSIDE).all(axis=(1, 2)) & (owner >= 0)
    weights = np.where(inside[:, None, None], weights, 0.0)
    own = own_paint(source)
    values: tuple[NDArray[np.floating], ...] = (source.paint.corner_uv, own.corner_tint, *source.paint.more_uv)
    uv, tint, *more = (np.einsum("mck,mki->mci", weights, rows[face]).astype(np.float32) for rows in values)
    texture, material = (np.where(inside, rows[face], np.int32(-1)) for rows in (own.texture, own.material))
    return replace(
        own, texture=texture, corner_uv=uv, corner_tint=tint, material=material, more_uv=tuple(more),
        cut_out=inside & own.cut_out[face],
    )  # fmt: skip


def own_paint(source: SourceSurface) -> CornerPaint:
    """Paint of a surface's own faces."""
    paint = source.paint
    more = tuple(uv.astype(np.float32) for uv in paint.more_uv)
    return CornerPaint(
        paint.face_texture, paint.corner_uv.astype(np.float32), tints(source), paint.textures, paint.wraps,
        paint.material_index, paint.materials, more, cut_out(source),
    )  # fmt: skip


def tints(source: SourceSurface) -> Float32Array:
    """Linear vertex colour times material colour at each corner, shape (m, 3, 3)."""
    return np.asarray(LINEAR[source.paint.face_color][:, None, :] * LINEAR[source.mesh.colors][source.mesh.faces])


def barycentric(points: NDArray[np.float64], triangle: NDArray[np.float64]) -> NDArray[np.float64]:
    """Barycentric coordinates of points (m, c, 3) in the planes of triangles (m, 3, 3), shape (m, c, 3); not finite for
    a triangle without area."""
    a, b, c = triangle.transpose(1, 0, 2)
    one, two, away = b - a, c - a, points - a[:, None]
    oo, ot, tt = (np.einsum("mi,mi->m", u, v) for u, v in ((one, one), (one, two), (two, two)))
    ao, at = (np.einsum("mci,mi->mc", away, u) for u in (one, two))
    with np.errstate(divide="ignore", invalid="ignore"):
        share = 1.0 / (oo * tt - ot * ot)[:, None]
        v = (tt[:, None] * ao - ot[:, None] * at) * share
        w = (oo[:, None] * at - ot[:, None] * ao) * share
        return np.stack([1.0 - v - w, v, w], axis=2)


class PaintedScene:
    """The textures of joined meshes."""

    def __init__(self, meshes: Sequence[PaintedMesh]) -> None:
        counts = [len(one.mesh.faces) for one in meshes]
        self.texture = np.full(sum(counts), -1, dtype=np.int32)
        self.uv = np.zeros((sum(counts), 3, 2), dtype=np.float32)
        self.tint = np.zeros((sum(counts), 3, 3), dtype=np.float32)
        self.levels: list[list[NDArray[np.uint8]]] = []
        self.wraps: list[Wrap] = []
        self.density = np.zeros(sum(counts), dtype=np.float32)
        start = 0
        for one, count in zip(meshes, counts, strict=True):
            mine = slice(start, start + count)
            start += count
            if one.paint is None:
                continue
            known = one.paint.texture >= 0
            self.texture[mine] = np.where(known, one.paint.texture + len(self.levels), -1)
            self.uv[mine], self.tint[mine] = one.paint.corner_uv, one.paint.corner_tint
            self.density[mine] = pixels_per_metre(one.mesh, one.paint)
            shown = set(one.paint.texture.tolist())
            self.levels += [
                smaller_copies(image) if slot in shown else [] for slot, image in enumerate(one.paint.textures)
            ]
            self.wraps += [one.paint.wrap(slot) for slot in range(len(one.paint.textures))]

    def paint(self, face: NDArray[np.int64], weights: Float32Array, pixel: Float32Array, color: Float32Array) -> None:
        """Overwrite linear colours (3, n) where rays met textured faces (n,) at weights (3, n); `pixel` is the width of
        a pixel of the picture there [m], shape (n,)."""
        slot = self.texture[face]
        for texture in np.unique(slot[slot >= 0]):
            mine = np.flatnonzero(slot == texture)
            own = face[mine]
            weight = weights[:, mine].T[:, :, None]
            uv, tint = (weight * self.uv[own]).sum(axis=1), (weight * self.tint[own]).sum(axis=1)
            levels = self.levels[texture]
            footprint = np.maximum(self.density[own] * pixel[mine], 1e-9)
            level = np.clip(np.rint(np.log2(footprint)), 0, len(levels) - 1).astype(np.int64)
            found = np.empty((len(mine), 3), dtype=np.float32)
            for each in np.unique(level):
                here = level == each
                found[here] = sampled(levels[each], uv[here], self.wraps[texture])
            color[:, mine] = (found * tint).T


def pixels_per_metre(mesh: Mesh, paint: CornerPaint) -> Float32Array:
    """Number of texture pixels per metre on each face, shape (m,)."""
    size = np.array([image.shape[1::-1] for image in paint.textures] + [(1, 1)], dtype=np.float64)
    corner = paint.corner_uv * size[paint.texture][:, None]
    one, two = corner[:, 1] - corner[:, 0], corner[:, 2] - corner[:, 0]
    pixels = 0.5 * np.abs(one[:, 0] * two[:, 1] - one[:, 1] * two[:, 0])
    return np.sqrt(pixels / np.maximum(mesh.face_areas, 1e-18)).astype(np.float32)


def smaller_copies(image: NDArray[np.uint8]) -> list[NDArray[np.uint8]]:
    """An image and its copies of half, a quarter ... of its size, each pixel the mean of four in linear light.

    Alpha is ignored.
    """
    levels = [image[..., :3]]
    while min(levels[-1].shape[:2]) >= 2:
        before = levels[-1]
        height, width = before.shape[0] // 2, before.shape[1] // 2
        four = LINEAR[before[: 2 * height, : 2 * width]].reshape(height, 2, width, 2, 3)
        levels.append(srgb_from_linear(four.mean(axis=(1, 3)).astype(np.float64)))
    return levels


def surface_colors(thing: PaintedMesh, face: NDArray[np.int64], weights: NDArray[np.floating]) -> NDArray[np.float64]:
    """sRGB 0..1 at places of a mesh given by faces (n,) and the weights of their corners (n, 3), shape (n, 3)."""
    mesh, paint = thing.mesh, thing.paint
    color = np.einsum("nk,nkc->nc", weights, mesh.colors[mesh.faces[face]] / 255.0)
    if paint is None:
        return np.asarray(color)
    for slot in np.unique(paint.texture[paint.texture >= 0]).tolist():
        image, mine = paint.textures[slot], np.flatnonzero(paint.texture[face] == slot)
        own, weight = face[mine], weights[mine][:, :, None]
        light = sampled(image, (weight * paint.corner_uv[own]).sum(axis=1), paint.wrap(slot))
        light *= (weight * paint.corner_tint[own]).sum(axis=1)
        color[mine] = srgb_from_linear(light) / 255.0
    return np.asarray(color)
