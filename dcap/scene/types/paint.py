"""Colours that belong to faces and textures rather than to vertices, and the surface of a file that has them."""

from dataclasses import dataclass
from typing import Self

import numpy as np
from numpy.typing import NDArray

from dcap.scene.errors import GeometryError
from dcap.scene.srgb import REPEATING, Wrap
from dcap.scene.types.arrays import check_array, check_index
from dcap.scene.types.mesh import Mesh


@dataclass(frozen=True, eq=False, slots=True)
class Paint:
    """Material colours and textures of the faces of a file."""

    face_color: NDArray[np.uint8]
    """Material colour (sRGB) that multiplies the texture, shape (m, 3)."""
    face_texture: NDArray[np.int32]
    """Index into `textures`, -1 for none, shape (m,)."""
    corner_uv: NDArray[np.float64]
    """Texture coordinates, origin at the lower left, shape (m, 3, 2)."""
    textures: tuple[NDArray[np.uint8], ...]
    """sRGB images, first row on top, each (h, w, 3)."""
    wraps: tuple[Wrap, ...] = ()
    """How each texture goes on beyond its image along u and v; empty: all repeat."""

    def __post_init__(self) -> None:
        count = len(self.face_color)
        check_array("face_color", self.face_color, count, 3)
        check_array("corner_uv", self.corner_uv, count, 3, 2)
        check_index("face_texture", self.face_texture, length=count, count=len(self.textures))
        if len(self.wraps) not in (0, len(self.textures)):
            raise GeometryError(f"wraps has {len(self.wraps)} entries, expected {len(self.textures)}")

    def wrap(self, texture: int) -> Wrap:
        """How a texture goes on beyond its image."""
        return self.wraps[texture] if self.wraps else REPEATING


@dataclass(frozen=True, eq=False, slots=True)
class SourceSurface:
    """A textured surface as its file has it: faces, corners and textures, in the world frame."""

    mesh: Mesh
    """Vertex colours multiply what the paint says; white where the file has none. No faces: nothing is textured."""
    paint: Paint

    @classmethod
    def untextured(cls) -> Self:
        """Of a file without textures: its mesh says all."""
        nothing = Paint(np.zeros((0, 3), np.uint8), np.zeros(0, np.int32), np.zeros((0, 3, 2)), ())
        return cls(Mesh.of(np.zeros((0, 3)), np.zeros((0, 3))), nothing)

    @property
    def textured(self) -> bool:
        """Whether it has textures."""
        return len(self.paint.textures) > 0


@dataclass(frozen=True, eq=False, slots=True)
class CornerPaint:
    """Textures of a mesh, corner by corner."""

    texture: NDArray[np.int32]
    """Index into `textures`; -1: the vertex colours say all, shape (m,)."""
    corner_uv: NDArray[np.float32]
    """Texture coordinates, origin at the lower left, shape (m, 3, 2)."""
    corner_tint: NDArray[np.float32]
    """Linear colour that multiplies the texture, 0..1, shape (m, 3, 3)."""
    textures: tuple[NDArray[np.uint8], ...]
    """sRGB images, first row on top, each (h, w, 3)."""
    wraps: tuple[Wrap, ...] = ()
    """As in `Paint`."""

    def wrap(self, texture: int) -> Wrap:
        """How a texture goes on beyond its image."""
        return self.wraps[texture] if self.wraps else REPEATING

    def of(self, faces: NDArray[np.integer]) -> Self:
        """That of some faces."""
        return type(self)(
            self.texture[faces], self.corner_uv[faces], self.corner_tint[faces], self.textures, self.wraps
        )


@dataclass(frozen=True, eq=False, slots=True)
class PaintedMesh:
    """A mesh and its textures."""

    mesh: Mesh
    paint: CornerPaint | None = None
    """None: the vertex colours say all."""

    def submesh(self, faces: NDArray[np.integer]) -> "PaintedMesh":
        """The given faces."""
        return PaintedMesh(self.mesh.submesh(faces), None if self.paint is None else self.paint.of(faces))

    def moved(self, mesh: Mesh) -> "PaintedMesh":
        """The same faces elsewhere."""
        return PaintedMesh(mesh, self.paint)
