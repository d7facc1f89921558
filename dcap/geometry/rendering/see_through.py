"""Rays that pass where the texture of a face is clear: leaves, lace, panes of a lantern.

In: meshes with textures. Out: a ray caster of them together, the plain one where nothing of them is clear. Every pass
of a picture uses the same caster, so that colour, depth, ids and shadows agree. A texel counts as there or not there:
with `MASK` as its cutoff says, with `BLEND` from an alpha of a half on. A factor that makes a whole blended material
transparent does not count, nor does the alpha of a material of which hardly anything would be left: glass is drawn.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from dcap.geometry.raycast import Packed, PackedHits, Raycaster
from dcap.scene.srgb import Wrap, texels
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.paint import CornerPaint, PaintedMesh, SourceSurface
from dcap.scene.types.surface_material import AlphaMode, SurfaceMaterial

HALF = 0.5
"""Alpha from which on blended texels are there [-]."""
LEAST_LEFT = 0.05
"""A material of whose area less than this is there is glass [-]."""
MOST_LAYERS = 64
"""Clear faces that one ray passes; the next one stops it."""
STEP = (2e-5, 1e-6)
"""A ray goes on this far behind a clear face: a share of the way to it, and more [m]."""
INSIDE = np.array([[1, 1, 1], [4, 1, 1], [1, 4, 1], [1, 1, 4], [2, 2, 1], [2, 1, 2], [1, 2, 2]], dtype=np.float64)
INSIDE = INSIDE / INSIDE.sum(axis=1, keepdims=True)
"""Barycentric places at which a face's alpha is looked up to tell glass, shape (7, 3)."""


def least_alpha(said: SurfaceMaterial) -> float:
    """Alpha of a texture from which on its texels are there; 0: all are."""
    if said.alpha_mode is AlphaMode.MASK:
        return said.alpha_cutoff / said.alpha if said.alpha > 0.0 else 0.0
    return HALF if said.alpha_mode is AlphaMode.BLEND else 0.0


def cut_out(source: SourceSurface) -> NDArray[np.bool_]:
    """Faces of a surface that rays pass where their texture is clear, shape (m,)."""
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
    """A ray caster of meshes together, faces in their order: of all of them, or of some (k,), which keep their numbers;
    `joined` are the meshes in one, if there is that already."""
    mesh = Mesh.concatenate([one.mesh for one in things]) if joined is None else joined
    if not any(one.paint is not None and one.paint.cut_out.any() for one in things):
        return Raycaster(mesh, faces)
    return SeeThroughCaster(mesh, things, faces)


class SeeThroughCaster(Raycaster):
    """A mesh with clear places, prepared for many rays."""

    def __init__(self, mesh: Mesh, things: Sequence[PaintedMesh], faces: NDArray[np.integer] | None = None) -> None:
        super().__init__(mesh, faces)
        self._paints = [one.paint for one in things]
        self._first = np.cumsum([0, *(len(one.mesh.faces) for one in things)])
        plain = [
            np.zeros(len(one.mesh.faces), dtype=bool) if one.paint is None else one.paint.cut_out for one in things
        ]
        self._cut_out = np.concatenate(plain)

    def first_hits(self, packed: Packed) -> PackedHits:
        """First hits of rays, past places that are cut out."""
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
        """Which rays hit anything that is there within the length of their direction."""
        stopped = super().blocked(packed)
        some = np.flatnonzero(stopped)
        if len(some):
            stopped[some] = self.first_hits(packed[some]).distance <= 1.0
        return stopped

    def _clear(self, hits: PackedHits) -> NDArray[np.bool_]:
        """Hits at places that are not there."""
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
    """Alpha of the textures at places of faces (n,), given by the weights of their corners (n, 3), less the one from
    which on texels are there, shape (n,)."""
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
