"""Triangle meshes with optional vertex colours, the only surfaces of the pipeline; materials and textures of files.

Invariant: finite vertices, face indices in range. Readers bake textures to vertex colours.

Properties of a face's material beyond its base colour: transparency, factors and further images.

Names, defaults and meanings are those of Khronos, "glTF 2.0 Specification", section 3.9 (materials).
"""

from dataclasses import dataclass, replace
from enum import StrEnum
from typing import Self

import numpy as np
from numpy.typing import NDArray

from dcap.scene.errors import GeometryError
from dcap.scene.srgb import REPEATING, Wrap
from dcap.scene.types.arrays import check_array, check_index


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
        """Corner positions of the given faces [m], shape (k, 3, 3)."""
        return np.asarray(self.vertices[self.faces[face_indices]])

    @property
    def face_normals(self) -> NDArray[np.float64]:
        """Area-weighted normals (length = twice the area) [m^2], shape (m, 3)."""
        a, b, c = self.triangles.transpose(1, 0, 2)
        return np.cross(b - a, c - a)

    @property
    def vertex_normals(self) -> NDArray[np.float64]:
        """Unit normals, averaged by area over the faces at each vertex; zero if these cancel, shape (n, 3)."""
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
        """The mesh under a 4x4 affine map; faces are reversed if the map mirrors."""
        linear, shift = world_from_mesh[:3, :3], world_from_mesh[:3, 3]
        faces = self.faces if np.linalg.det(linear) > 0 else self.faces[:, ::-1].copy()
        return replace(self, vertices=self.vertices @ linear.T + shift, faces=faces)

    def submesh(self, face_indices: NDArray[np.integer]) -> Self:
        """The given faces with only the vertices that they use."""
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


class AlphaMode(StrEnum):
    """Meaning of the alpha of a base colour."""

    OPAQUE = "OPAQUE"
    """Alpha is ignored."""
    MASK = "MASK"
    """Texels with alpha below the cutoff are cut away."""
    BLEND = "BLEND"
    """Alpha blends the surface with the background."""


@dataclass(frozen=True, slots=True)
class MaterialMap:
    """A further image of a material."""

    texture: int
    """Index into the paint's textures."""
    uv_set: int = 0
    """Index of the texture coordinates: 0 for those of the base colour, else one more than the index into `more_uv`."""
    strength: float = 1.0
    """Scale of a normal map, strength of an occlusion map; 1 for others [-]."""


@dataclass(frozen=True, slots=True)
class SurfaceMaterial:
    """A material of a file, without its base colour, which is in the paint."""

    name: str = ""
    alpha_mode: AlphaMode = AlphaMode.OPAQUE
    alpha_cutoff: float = 0.5
    """Least visible alpha with `MASK` [-]."""
    alpha: float = 1.0
    """Factor of the texture's alpha, 0..1 [-]."""
    metallic: float | None = None
    """Factor 0..1 [-]; None: not stated in the file."""
    roughness: float | None = None
    """Factor 0..1 [-]; None: not stated in the file."""
    emission: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Linear factor 0..1 of the emitted light."""
    double_sided: bool | None = None
    """Whether back faces are visible; None: not stated in the file."""
    metallic_roughness_map: MaterialMap | None = None
    """Roughness in green, metalness in blue, both linear."""
    normal_map: MaterialMap | None = None
    """Tangent-space normals, linear."""
    occlusion_map: MaterialMap | None = None
    """Ambient occlusion in red, linear."""
    emissive_map: MaterialMap | None = None
    """Emitted light, sRGB."""

    @property
    def maps(self) -> tuple[MaterialMap, ...]:
        """All further images."""
        each = (self.metallic_roughness_map, self.normal_map, self.occlusion_map, self.emissive_map)
        return tuple(one for one in each if one is not None)


PLAIN = SurfaceMaterial()
"""Material of a face with only a colour."""


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
    """Images of base colours and further maps, first row on top, each (h, w, 3), or (h, w, 4) if its alpha counts; base
    colours and emitted light are sRGB."""
    wraps: tuple[Wrap, ...] = ()
    """Wrapping of each texture beyond its image along u and v; empty: all repeat."""
    face_material: NDArray[np.int32] | None = None
    """Index into `materials`, shape (m,); None: materials only have colours."""
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
        """Whether there is anything beyond vertex colours."""
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
        """Whether there is more than a mesh with vertex colours."""
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
    """Whether rays pass through the transparent texels of a face, shape (m,)."""

    def wrap(self, texture: int) -> Wrap:
        """Wrapping of a texture beyond its image."""
        return self.wraps[texture] if self.wraps else REPEATING

    def of(self, faces: NDArray[np.integer]) -> Self:
        """The paint of the given faces."""
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
