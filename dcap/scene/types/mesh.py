"""A triangle mesh with optional vertex colours: the only surface type of the pipeline.

Invariant: finite vertices, face indices in range. Readers bake textures to vertex colours.
"""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from dcap.scene.errors import GeometryError


@dataclass(frozen=True, eq=False, slots=True)
class Mesh:
    """Triangles in metres, right-handed, z up unless the owner says otherwise."""

    vertices: NDArray[np.float64]
    """Vertex positions [m], shape (n, 3)."""
    faces: NDArray[np.int32]
    """Counter-clockwise vertex indices, shape (m, 3)."""
    colors: NDArray[np.uint8]
    """sRGB vertex colours 0..255, shape (n, 3)."""

    def __post_init__(self) -> None:
        count = len(self.vertices)
        if self.vertices.ndim != 2 or self.vertices.shape[1] != 3:
            raise GeometryError(f"vertices have shape {self.vertices.shape}, expected (n, 3)")
        if self.faces.ndim != 2 or self.faces.shape[1] != 3:
            raise GeometryError(f"faces have shape {self.faces.shape}, expected (m, 3)")
        if self.colors.shape != self.vertices.shape:
            raise GeometryError(f"colors have shape {self.colors.shape}, expected {self.vertices.shape}")
        if not np.isfinite(self.vertices).all():
            bad = int(np.flatnonzero(~np.isfinite(self.vertices).all(axis=1))[0])
            raise GeometryError(f"vertex {bad} is not finite: {self.vertices[bad].tolist()}")
        if len(self.faces) and (self.faces.min() < 0 or self.faces.max() >= count):
            raise GeometryError(f"face indices {self.faces.min()}..{self.faces.max()} outside 0..{count - 1}")

    @classmethod
    def of(cls, vertices: object, faces: object, colors: object = None) -> Self:
        """Build from array-like input; a missing or single colour is repeated (default light grey)."""
        points = np.ascontiguousarray(vertices, dtype=np.float64).reshape(-1, 3)
        shade = np.asarray((200, 200, 200) if colors is None else colors, dtype=np.uint8)
        return cls(
            points,
            np.ascontiguousarray(faces, dtype=np.int32).reshape(-1, 3),
            np.ascontiguousarray(np.broadcast_to(shade, points.shape)),
        )

    @property
    def bounds(self) -> NDArray[np.float64]:
        """Axis-aligned bounds [m], shape (2, 3): minimum, maximum."""
        return np.stack([self.vertices.min(axis=0), self.vertices.max(axis=0)])

    @property
    def triangles(self) -> NDArray[np.float64]:
        """Corner positions [m], shape (m, 3, 3)."""
        return self.vertices[self.faces]

    def corners(self, face_indices: NDArray[np.integer]) -> NDArray[np.float64]:
        """Corner positions of the given faces alone [m], shape (k, 3, 3)."""
        return np.asarray(self.vertices[self.faces[face_indices]])

    @property
    def face_normals(self) -> NDArray[np.float64]:
        """Area-weighted normals (length = twice the area) [m^2], shape (m, 3)."""
        a, b, c = self.triangles.transpose(1, 0, 2)
        return np.cross(b - a, c - a)

    @property
    def vertex_normals(self) -> NDArray[np.float64]:
        """Unit normals, averaged by area over the faces at each vertex; zero where these cancel, shape (n, 3)."""
        normals = np.zeros_like(self.vertices)
        weighted = np.repeat(self.face_normals, 3, axis=0)
        for axis in range(3):
            normals[:, axis] = np.bincount(self.faces.ravel(), weighted[:, axis], len(self.vertices))
        lengths: NDArray[np.float64] = np.linalg.norm(normals, axis=1, keepdims=True)
        normals /= np.maximum(lengths, 1e-30)
        return normals

    @property
    def face_areas(self) -> NDArray[np.float64]:
        """Areas [m^2], shape (m,)."""
        areas: NDArray[np.float64] = 0.5 * np.linalg.norm(self.face_normals, axis=1)
        return areas

    def transformed(self, world_from_mesh: NDArray[np.float64]) -> Self:
        """The mesh under a 4x4 affine map; faces are flipped if the map mirrors."""
        linear, shift = world_from_mesh[:3, :3], world_from_mesh[:3, 3]
        faces = self.faces if np.linalg.det(linear) > 0 else self.faces[:, ::-1].copy()
        return replace(self, vertices=self.vertices @ linear.T + shift, faces=faces)

    def submesh(self, face_indices: NDArray[np.integer]) -> Self:
        """The given faces with only the vertices they use."""
        faces = self.faces[face_indices]
        used, inverse = np.unique(faces, return_inverse=True)
        return type(self)(self.vertices[used], inverse.reshape(-1, 3).astype(np.int32), self.colors[used])

    @classmethod
    def concatenate(cls, meshes: "list[Mesh]") -> "Mesh":
        """Join meshes into one; faces keep their order."""
        if not meshes:
            return Mesh.of(np.zeros((0, 3)), np.zeros((0, 3)))
        offsets = np.cumsum([0] + [len(m.vertices) for m in meshes[:-1]])
        return Mesh(
            np.concatenate([m.vertices for m in meshes]),
            np.concatenate([m.faces + o for m, o in zip(meshes, offsets, strict=True)]).astype(np.int32),
            np.concatenate([m.colors for m in meshes]),
        )
