"""Textures and material colours baked to vertex colours.

Faces on which the texture varies more than three corner colours can represent are cut first, along shared edges, so
that the surface stays closed. Vertices are split only if the colours that meet in them differ visibly.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dcap.scene.readers.mesh.raw import RawMesh
from dcap.scene.srgb import linear_from_srgb, sampled, srgb_from_linear
from dcap.scene.types.mesh import Paint

EDGE_FRACTION = 0.01
"""Target edge of faces with a varying texture, as a share of the mesh's largest extent [-]."""

LONGEST_SIDE = 2.0
"""Sides longer than this many target edges are cut, so that the pieces are no shorter than the target [-]."""

MAX_BAKED_FACES = 150_000
"""Maximum number of faces after cutting [-]."""

VISIBLE_VARIATION = 6.0
"""Root mean square difference from linear interpolation that justifies a cut [sRGB levels]: barely visible."""

VISIBLE_STEP = 40.0
"""Difference of colours at one vertex above which they form a border and stay apart [sRGB levels]."""

MAX_ROUNDS = 8
"""Maximum number of rounds; each halves edges, and 2^8 covers an edge as long as the mesh [-]."""


@dataclass
class TexturedSurface:
    """Triangles whose corners carry their own texture coordinates."""

    points: NDArray[np.float64]
    faces: NDArray[np.int64]
    corner_uv: NDArray[np.float64]
    corner_tint: NDArray[np.float64]
    """Linear vertex colour times material colour at each corner, 0..1, shape (m, 3, 3)."""
    texture: NDArray[np.int32]
    node: NDArray[np.int32]

    def take(self, faces: NDArray[np.int64]) -> "TexturedSurface":
        """The given faces; points are shared."""
        return TexturedSurface(
            self.points,
            self.faces[faces],
            self.corner_uv[faces],
            self.corner_tint[faces],
            self.texture[faces],
            self.node[faces],
        )


def bake(raw: RawMesh) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.uint8], NDArray[np.int32]]:
    """Vertices (n, 3), faces (m, 3), vertex colours (n, 3) and the node of each face (m,)."""
    if raw.paint is None:
        colors = np.full(raw.vertices.shape, 200, dtype=np.uint8) if raw.colors is None else raw.colors
        return raw.vertices, raw.faces, colors, raw.face_node
    surface = _welded(raw, raw.paint)
    images = raw.paint
    surface = _refined(surface, images)
    corner_colors = srgb_from_linear(_corner_colors(surface, images)).astype(np.float64)
    vertices, faces, shades = _split_at_borders(surface, corner_colors)
    return vertices, faces, shades, surface.node


def _welded(raw: RawMesh, paint: Paint) -> TexturedSurface:
    """The surface with shared positions merged into one point, so that cuts on either side of a texture seam agree."""
    points, index = np.unique(raw.vertices, axis=0, return_inverse=True)
    tint = np.broadcast_to(linear_from_srgb(paint.face_color)[:, None, :], (len(raw.faces), 3, 3))
    if raw.colors is not None:
        tint = tint * linear_from_srgb(raw.colors)[raw.faces]
    return TexturedSurface(
        points, index.reshape(-1)[raw.faces], paint.corner_uv, np.array(tint), paint.face_texture, raw.face_node
    )


def _colors_at(surface: TexturedSurface, images: Paint, weights: NDArray[np.float64]) -> NDArray[np.float64]:
    """Linear colours at the barycentric positions `weights` (k, 3) of every face, shape (m, k, 3)."""
    colors: NDArray[np.float64] = np.einsum("kc,mci->mki", weights, surface.corner_tint)
    uv = np.einsum("kc,mci->mki", weights, surface.corner_uv)
    for slot in range(len(images.textures)):
        chosen = np.flatnonzero(surface.texture == slot)
        colors[chosen] *= sampled(images.textures[slot], uv[chosen], images.wrap(slot))
    return colors


def _corner_colors(surface: TexturedSurface, images: Paint) -> NDArray[np.float64]:
    """Linear colour at each corner: the mean of four samples inside the face, so that no other part of the texture
    bleeds in."""
    near = np.array([[0.9, 0.05, 0.05], [0.7, 0.15, 0.15], [0.75, 0.2, 0.05], [0.75, 0.05, 0.2]])
    corners = [_colors_at(surface, images, near[:, np.roll([0, 1, 2], turn)]).mean(axis=1) for turn in range(3)]
    return np.stack(corners, axis=1)


def _varies(surface: TexturedSurface, images: Paint) -> NDArray[np.bool_]:
    """Mask of the faces whose texture departs visibly from the interpolation of their corners, shape (m,)."""
    steps = 7
    grid = (
        np.array([[i, j, steps - i - j] for i in range(1, steps) for j in range(1, steps - i)], dtype=np.float64)
        / steps
    )
    corners = srgb_from_linear(_corner_colors(surface, images)).astype(np.float64)
    seen = srgb_from_linear(_colors_at(surface, images, grid)).astype(np.float64)
    expected = np.einsum("kc,mci->mki", grid, corners)
    return np.asarray(np.sqrt(((seen - expected) ** 2).mean(axis=(1, 2))) > VISIBLE_VARIATION)


def _refined(surface: TexturedSurface, images: Paint) -> TexturedSurface:
    """The surface with faces cut until the texture is preserved or the edge or face limit is reached."""
    extent = float(np.ptp(surface.points, axis=0).max())
    target = EDGE_FRACTION * extent
    for _ in range(MAX_ROUNDS):
        textured = np.flatnonzero((surface.texture >= 0) & (_longest_side(surface) > LONGEST_SIDE * target))
        needy = np.zeros(len(surface.faces), dtype=bool)
        if len(textured):
            needy[textured] = _varies(surface.take(textured), images)
        marks = _marked_edges(surface, needy, LONGEST_SIDE * target)
        if not marks.any() or len(surface.faces) + int(marks.sum()) > MAX_BAKED_FACES:
            return surface
        surface = _cut(surface, marks)
    return surface


def _longest_side(surface: TexturedSurface) -> NDArray[np.float64]:
    """Length of the longest side of each face, shape (m,)."""
    corners = surface.points[surface.faces]
    return np.asarray(np.linalg.norm(corners - np.roll(corners, -1, axis=1), axis=2).max(axis=1))


def _edge_ids(faces: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Unique edges (e, 2) and the edge of each side i -> i+1 of each face (m, 3)."""
    sides = np.sort(np.stack([faces, np.roll(faces, -1, axis=1)], axis=2), axis=2).reshape(-1, 2)
    key = sides[:, 0] * (faces.max() + 1) + sides[:, 1]
    _, first, inverse = np.unique(key, return_index=True, return_inverse=True)
    return sides[first], inverse.reshape(-1, 3)


def _marked_edges(surface: TexturedSurface, needy: NDArray[np.bool_], longest: float) -> NDArray[np.bool_]:
    """Sides to cut, shape (m, 3): long sides of faces that need it, and the same edges of their neighbours."""
    edges, side = _edge_ids(surface.faces)
    length = np.linalg.norm(surface.points[edges[:, 0]] - surface.points[edges[:, 1]], axis=1)
    own = length[side]
    wish = needy[:, None] & (own > longest) & (own > 0.5 * own.max(axis=1, keepdims=True))
    cut = np.zeros(len(edges), dtype=bool)
    cut[side[wish]] = True
    return np.asarray(cut[side])


CHILDREN = {
    (False, False, False): [[0, 1, 2]],
    (True, False, False): [[0, 3, 2], [3, 1, 2]],
    (True, True, False): [[0, 3, 2], [3, 4, 2], [3, 1, 4]],
    (True, True, True): [[0, 3, 5], [3, 1, 4], [5, 4, 2], [3, 4, 5]],
}
"""Children of a face by its cut sides; 0..2 are its corners, 3..5 the middles of sides 0-1, 1-2, 2-0."""


def _cut(surface: TexturedSurface, marks: NDArray[np.bool_]) -> TexturedSurface:
    """The surface with every marked side cut in the middle; neighbours share the new points."""
    edges, side = _edge_ids(surface.faces)
    cut = np.zeros(len(edges), dtype=bool)
    cut[side[marks]] = True
    middle_of_edge = np.where(cut, len(surface.points) + np.cumsum(cut) - 1, -1)
    points = np.concatenate([surface.points, surface.points[edges[cut]].mean(axis=1)])
    index = np.concatenate([surface.faces, middle_of_edge[side]], axis=1)
    uv, tint = _with_middles(surface.corner_uv), _with_middles(surface.corner_tint)
    pieces: list[tuple[NDArray[np.int64], NDArray[np.int64]]] = []
    for pattern, children in CHILDREN.items():
        for turn in range(1 if len(set(pattern)) == 1 else 3):
            chosen = np.flatnonzero((np.roll(marks, -turn, axis=1) == pattern).all(axis=1))
            turned = [[(c + turn) % 3 + 3 * (c >= 3) for c in child] for child in children]
            pieces += [(chosen, np.broadcast_to(np.array(child), (len(chosen), 3))) for child in turned]
    parent = np.concatenate([piece[0] for piece in pieces])
    corner = np.concatenate([piece[1] for piece in pieces])
    order = np.argsort(parent, kind="stable")
    parent, corner = parent[order], corner[order]
    rows = parent[:, None]
    return TexturedSurface(
        points, index[rows, corner], uv[rows, corner], tint[rows, corner], surface.texture[parent], surface.node[parent]
    )


def _with_middles(corner: NDArray[np.float64]) -> NDArray[np.float64]:
    """Values at the corners and side middles, shape (m, 6, k), from those at the corners, (m, 3, k)."""
    return np.concatenate([corner, 0.5 * (corner + np.roll(corner, -1, axis=1))], axis=1)


def _split_at_borders(
    surface: TexturedSurface, colors: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.int64], NDArray[np.uint8]]:
    """One vertex for each point and visibly different colour: positions (n, 3), faces (m, 3), colours (n, 3)."""
    corner = surface.faces.reshape(-1)
    shade = colors.reshape(-1, 3)
    count = np.bincount(corner, minlength=len(surface.points))
    total = np.stack([np.bincount(corner, shade[:, i], len(surface.points)) for i in range(3)], axis=1)
    mean = total / np.maximum(count, 1)[:, None]
    spread = np.zeros(len(surface.points))
    np.maximum.at(spread, corner, np.abs(shade - mean[corner]).max(axis=1))
    # Five levels per channel distinguish materials; the exact mean of each group is kept below.
    level = np.rint(shade / 64.0).astype(np.int64) @ np.array([25, 5, 1]) + 1
    key = corner * 126 + np.where(spread[corner] > VISIBLE_STEP, level, 0)
    _, first, inverse = np.unique(key, return_index=True, return_inverse=True)
    number = np.asarray(inverse)
    size = np.bincount(number)
    vertex_color = np.stack([np.bincount(number, shade[:, i]) / size for i in range(3)], axis=1)
    return (
        surface.points[corner[first]],
        inverse.reshape(-1, 3).astype(np.int64),
        np.rint(vertex_color).astype(np.uint8),
    )
