"""Colours of faces and textures rather than vertices, and the surface of a file that has them."""

from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray

from dcap.scene.errors import GeometryError
from dcap.scene.srgb import REPEATING, Wrap
from dcap.scene.types.arrays import check_array, check_index
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.surface_material import PLAIN, SurfaceMaterial


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
    """Images of base colours and further maps, first row on top, each (h, w, 3), or (h, w, 4) where its alpha counts;
    base colours and light are sRGB."""
    wraps: tuple[Wrap, ...] = ()
    """Wrapping of each texture beyond its image along u and v; empty: all repeat."""
    face_material: NDArray[np.int32] | None = None
    """Index into `materials`, shape (m,); None: materials have nothing but their colours."""
    materials: tuple[SurfaceMaterial, ...] = (PLAIN,)
    more_uv: tuple[NDArray[np.float64], ...] = ()
    """Texture coordinates of maps that do not use `corner_uv`, each (m, 3, 2)."""

    def __post_init__(self) -> None:
        count = len(self.face_color)
        check_array("face_color", self.face_color, count, 3)
        check_array("corner_uv", self.corner_uv, count, 3, 2)
        check_index("face_texture", self.face_texture, length=count, count=len(self.textures))
        if self.face_material is not None:
            check_index("face_material", self.face_material, length=count, count=len(self.materials))
        for number, uv in enumerate(self.more_uv):
            check_array(f"more_uv {number}", uv, count, 3, 2)
        for one in (used for material in self.materials for used in material.maps):
            if not (0 <= one.texture < len(self.textures) and 0 <= one.uv_set <= len(self.more_uv)):
                raise GeometryError(f"a map uses texture {one.texture} with coordinates {one.uv_set}: there are none")
        if len(self.wraps) not in (0, len(self.textures)):
            raise GeometryError(f"wraps has {len(self.wraps)} entries, expected {len(self.textures)}")

    def wrap(self, texture: int) -> Wrap:
        """Wrapping of a texture beyond its image."""
        return self.wraps[texture] if self.wraps else REPEATING

    @property
    def material_index(self) -> NDArray[np.int32]:
        """Index into `materials` of each face, shape (m,)."""
        return np.zeros(len(self.face_texture), np.int32) if self.face_material is None else self.face_material

    @property
    def says_more(self) -> bool:
        """Whether it has anything beyond vertex colours."""
        return len(self.textures) > 0 or any(one != PLAIN for one in self.materials)


@dataclass(frozen=True, eq=False, slots=True)
class SourceSurface:
    """The surface of a file: faces, corners, textures and materials, in the world frame."""

    mesh: Mesh
    """Vertex colours multiply the paint; white if the file has none. Without faces the paint has no content."""
    paint: Paint

    @classmethod
    def untextured(cls) -> Self:
        """The surface of a file without textures and materials, given by its mesh alone."""
        nothing = Paint(np.zeros((0, 3), np.uint8), np.zeros(0, np.int32), np.zeros((0, 3, 2)), ())
        return cls(Mesh.of(np.zeros((0, 3)), np.zeros((0, 3))), nothing)

    @property
    def kept(self) -> bool:
        """Whether it has more than a mesh with vertex colours."""
        return self.paint.says_more

    @property
    def textured(self) -> bool:
        """Whether base colours have textures."""
        return bool((self.paint.face_texture >= 0).any())


@dataclass(frozen=True, eq=False, slots=True)
class CornerPaint:
    """Textures and materials of a mesh, corner by corner."""

    texture: NDArray[np.int32]
    """Index into `textures`, -1 for none, shape (m,)."""
    corner_uv: NDArray[np.float32]
    """Texture coordinates, origin at the lower left, shape (m, 3, 2)."""
    corner_tint: NDArray[np.float32]
    """Linear colour that multiplies the texture, 0..1, shape (m, 3, 3)."""
    textures: tuple[NDArray[np.uint8], ...]
    """As in `Paint`."""
    wraps: tuple[Wrap, ...]
    """As in `Paint`."""
    material: NDArray[np.int32]
    """Index into `materials`; -1: vertex colours only, shape (m,)."""
    materials: tuple[SurfaceMaterial, ...]
    more_uv: tuple[NDArray[np.float32], ...]
    """As in `Paint`."""
    cut_out: NDArray[np.bool_]
    """Whether rays pass through transparent texels of faces, shape (m,)."""

    def wrap(self, texture: int) -> Wrap:
        """Wrapping of a texture beyond its image."""
        return self.wraps[texture] if self.wraps else REPEATING

    def of(self, faces: NDArray[np.integer]) -> Self:
        """The paint of some faces."""
        return replace(
            self,
            texture=self.texture[faces],
            corner_uv=self.corner_uv[faces],
            corner_tint=self.corner_tint[faces],
            material=self.material[faces],
            more_uv=tuple(uv[faces] for uv in self.more_uv),
            cut_out=self.cut_out[faces],
        )


@dataclass(frozen=True, eq=False, slots=True)
class PaintedMesh:
    """A mesh and its textures."""

    mesh: Mesh
    paint: CornerPaint | None = None
    """None: vertex colours only."""

    def submesh(self, faces: NDArray[np.integer]) -> "PaintedMesh":
        """The painted mesh of the given faces."""
        return PaintedMesh(self.mesh.submesh(faces), None if self.paint is None else self.paint.of(faces))

    def moved(self, mesh: Mesh) -> "PaintedMesh":
        """The same faces at other positions."""
        return PaintedMesh(mesh, self.paint)
