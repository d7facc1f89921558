"""The meshes of a USD stage and their textures, read by Pixar's library in a process of its own.

    python usd_stage.py FILE CPU_SECONDS BYTES > arrays.npz, or one line of JSON with exit code 3

Subdivision surfaces are read as their cages; spheres and other analytic shapes are left out. Source: Pixar, "USD Geom
schema": Mesh, Primvar, stage metadata `upAxis` and `metersPerUnit`.

Base-colour textures of a USD stage, read by Pixar's library within the process of `usd_stage`.

Reads `UsdUVTexture` nodes at the `diffuseColor` of a `UsdPreviewSurface`, with the coordinates that their
`UsdPrimvarReader_float2` names, through a `UsdTransform2d` if there is one. Only images next to the stage or within its
package count. Source: Pixar, "UsdPreviewSurface Specification", version 2.6.
"""

import io
import json
import resource
import sys
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dcap.scene.errors import FormatError, InputError
from dcap.scene.readers.mesh.raw import check_face_count, check_vertex_count, triangulate
from dcap.scene.srgb import CLAMP, MIRROR, REPEAT, Wrap, srgb_from_linear

Prim = Any
"""Object of that name in the library, which has no types."""

WRAPS = {"repeat": REPEAT, "mirror": MIRROR, "clamp": CLAMP, "black": CLAMP}
COORDINATES = "st"
"""Default primvar of texture coordinates."""
Stage = Any

"""Object of that name in the library, which has no types."""

REFUSED = 3
"""Exit code if a line describes the problem."""

FLATTEN = "flatten it into one file: `usdcat --flatten in.usd -o out.usdc`"

GREY = 200
"""Grey level of meshes without a colour next to meshes with one [sRGB]."""


@dataclass(frozen=True, eq=False)
class Texture:
    """A texture of a material."""

    slot: int
    """Index of its image with its wrapping."""
    primvar: str
    uv_from_primvar: NDArray[np.float64]
    """Texture transform, shape (3, 2): rows for u, v and 1."""


@dataclass
class StageTextures:
    """Collects the textures of the meshes of a stage."""

    path: Path
    time: Any
    images: list[bytes] = field(default_factory=list)
    wraps: list[Wrap] = field(default_factory=list)
    _slots: dict[tuple[str, Wrap], int] = field(default_factory=dict)
    _textures: dict[str, Texture | None] = field(default_factory=dict)

    def of(
        self, prim: Prim, polygon: NDArray[np.int64], corner: NDArray[np.int64], index: NDArray[np.int64], points: int
    ) -> tuple[NDArray[np.int32], NDArray[np.float64]]:
        """Texture (t,) and coordinates (t, 3, 2) of triangles of a mesh.

        Args:
            prim: the mesh.
            polygon: the polygon of each triangle, shape (t,).
            corner: numbers of its corners among those of all polygons, shape (t, 3).
            index: vertex of each corner.
            points: how many vertices there are.
        """
        texture, uv = np.full(len(polygon), -1, dtype=np.int32), np.zeros((len(polygon), 3, 2))
        for faces, found in self._bound(prim):
            mine = np.arange(len(polygon)) if faces is None else np.flatnonzero(np.isin(polygon, faces))
            values = None if found is None else self._coordinates(prim, found.primvar, index, points)
            if found is None or values is None:
                texture[mine] = -1
                continue
            texture[mine] = found.slot
            uv[mine] = values[corner[mine]] @ found.uv_from_primvar[:2] + found.uv_from_primvar[2]
        return texture, uv

    def _bound(self, prim: Prim) -> list[tuple[NDArray[np.int64] | None, Texture | None]]:
        """The texture of the mesh's own material, then those of its subsets with their polygons."""
        from pxr import UsdShade

        binding = UsdShade.MaterialBindingAPI(prim)
        found: list[tuple[NDArray[np.int64] | None, Texture | None]] = [
            (None, self._texture(binding.ComputeBoundMaterial()[0]))
        ]
        for subset in binding.GetMaterialBindSubsets():
            faces = np.array(subset.GetIndicesAttr().Get(self.time) or (), dtype=np.int64)
            material = UsdShade.MaterialBindingAPI(subset.GetPrim()).ComputeBoundMaterial()[0]
            found.append((faces, self._texture(material)))
        return found

    def _texture(self, material: Any) -> Texture | None:
        if not material:
            return None
        key = str(material.GetPath())
        if key not in self._textures:
            self._textures[key] = self._read(material)
        return self._textures[key]

    def _read(self, material: Any) -> Texture | None:
        """Texture connected to the diffuse colour of a material's surface."""
        surface = material.ComputeSurfaceSource()[0]
        node = _source(surface, "diffuseColor") if surface else None
        if node is None or node.GetIdAttr().Get() != "UsdUVTexture":
            return None
        along_u, along_v = (WRAPS.get(str(_value(node, name)), REPEAT) for name in ("wrapS", "wrapT"))
        slot = self._slot(_value(node, "file"), (along_u, along_v))
        turn, reader = np.array([[1.0, 0.0], [0.0, 1.0], [0.0, 0.0]]), _source(node, "st")
        if reader is not None and reader.GetIdAttr().Get() == "UsdTransform2d":
            turn, reader = _transform(reader), _source(reader, "in")
        name = (reader is not None and _value(reader, "varname")) or COORDINATES
        return None if slot is None else Texture(slot, str(name), turn)

    def _slot(self, asset: Any, wrap: Wrap) -> int | None:
        """Slot of an image; None if it is missing, or lies outside the stage's folder and package."""
        from pxr import Ar

        where = str(getattr(asset, "resolvedPath", "") or "")
        if not where or not Path(where).resolve().is_relative_to(self.path.parent.resolve()):
            return None
        if (where, wrap) not in self._slots:
            opened = Ar.GetResolver().OpenAsset(Ar.ResolvedPath(where))
            if not opened:
                return None
            self._slots[where, wrap] = len(self.images)
            self.images.append(bytes(opened.GetBuffer()))
            self.wraps.append(wrap)
        return self._slots[where, wrap]

    def _coordinates(self, prim: Prim, name: str, index: NDArray[np.int64], points: int) -> NDArray[np.float64] | None:
        """Texture coordinates at each corner of the polygons, shape (c, 2); None if the mesh has none."""
        from pxr import UsdGeom

        primvar = UsdGeom.PrimvarsAPI(prim).FindPrimvarWithInheritance(name)
        value = primvar.ComputeFlattened(self.time) if primvar and primvar.HasValue() else None
        uv = np.array(value or (), dtype=np.float64)
        if uv.ndim != 2 or uv.shape[1] != 2 or len(uv) not in (len(index), points):
            return None
        return uv if primvar.GetInterpolation() == UsdGeom.Tokens.faceVarying and len(uv) == len(index) else uv[index]


def _source(node: Any, name: str) -> Any:
    """The shader connected to an input of a shader; None if there is none."""
    from pxr import UsdShade

    found = node.GetInput(name)
    sources = found.GetConnectedSources()[0] if found else []
    return UsdShade.Shader(sources[0].source.GetPrim()) if sources else None


def _value(node: Any, name: str) -> Any:
    """The value of an input, its own or that of its connection; None if there is none."""
    found = node.GetInput(name)
    attributes = found.GetValueProducingAttributes() if found else []
    return attributes[0].Get() if attributes else None


def _transform(node: Any) -> NDArray[np.float64]:
    """Scale, rotation and translation of texture coordinates: rows for u, v and 1, shape (3, 2)."""
    scale, angle = _value(node, "scale") or (1.0, 1.0), np.radians(float(_value(node, "rotation") or 0.0))
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    move = np.array(_value(node, "translation") or (0.0, 0.0), dtype=np.float64)
    return np.vstack([np.diag(np.array(scale, dtype=np.float64)) @ turn, move])


def main(path: Path, cpu_seconds: int, memory: int) -> int:
    """Write the arrays, or the problem, to standard output."""
    resource.setrlimit(resource.RLIMIT_CPU, (cpu_seconds, cpu_seconds))
    resource.setrlimit(resource.RLIMIT_AS, (memory, memory))
    from pxr import Tf

    try:
        try:
            arrays = read_stage(path)
        except Tf.ErrorException as error:
            raise FormatError(f"{path}: USD cannot read it: {_first_line(error)}") from None
        except (ValueError, TypeError, LookupError, MemoryError) as error:
            raise FormatError(f"{path}: the stage contradicts itself ({_first_line(error)})") from None
    except InputError as error:
        print(json.dumps({"broken": isinstance(error, FormatError), "message": str(error)}))  # noqa: T201 its output
        return REFUSED
    buffer = io.BytesIO()
    np.savez(buffer, allow_pickle=False, **arrays)
    sys.stdout.buffer.write(buffer.getvalue())
    return 0


def read_stage(path: Path) -> dict[str, NDArray[np.generic]]:
    """Every mesh of a stage; helpers and hidden meshes only if there are no others."""
    from pxr import UsdGeom

    stage = _stage(path)
    builder = _UsdBuilder(path)
    for prim in _meshes(path, stage):
        builder.add(prim)
    stated = UsdGeom.StageHasAuthoredMetersPerUnit(stage)
    up = str(UsdGeom.GetStageUpAxis(stage)).lower() if stage.HasAuthoredMetadata("upAxis") else ""
    unit = float(UsdGeom.GetStageMetersPerUnit(stage)) if stated else 0.0
    return builder.arrays() | {"up": np.array(up), "unit_metres": np.array(unit)}


def _stage(path: Path) -> Stage:
    """The composed stage; all files that it refers to must exist."""
    from pxr import Usd

    stage = Usd.Stage.Open(str(path))
    errors = stage.GetCompositionErrors()
    if errors:
        raise FormatError(f"{path}: {_first_line(errors[0])}; {FLATTEN}")
    home = path.parent.resolve()
    for layer in stage.GetUsedLayers():
        place = Path(layer.realPath.partition("[")[0])  # for a layer in a package, the path of the package
        if layer.realPath and not place.resolve().is_relative_to(home):
            raise FormatError(f"{path}: it refers to {place}, which lies outside of the file's folder; {FLATTEN}")
    return stage


def _first_line(error: object) -> str:
    """A message of the library in one line."""
    return " ".join(str(error).split())[:300]


def _meshes(path: Path, stage: Stage) -> list[Prim]:
    """The prims that are meshes, including those within instances."""
    from pxr import Usd, UsdGeom

    shown: list[Prim] = []
    hidden: list[Prim] = []
    for prim in Usd.PrimRange.Stage(stage, Usd.TraverseInstanceProxies()):
        if not prim.IsA(UsdGeom.Mesh):
            continue
        one = UsdGeom.Imageable(prim)
        visible = one.ComputeVisibility() != UsdGeom.Tokens.invisible
        drawn = one.ComputePurpose() in (UsdGeom.Tokens.default_, UsdGeom.Tokens.render)
        (shown if visible and drawn else hidden).append(prim)
    if not shown and not hidden:
        raise InputError(f"{path}: the stage has no mesh; a surface is needed")
    return shown or hidden


class _UsdBuilder:
    """Collects meshes into one."""

    def __init__(self, path: Path) -> None:
        from pxr import Usd, UsdGeom

        self.path = path
        self.time = Usd.TimeCode.EarliestTime()
        self.frames = UsdGeom.XformCache(self.time)
        self.names: list[str] = []
        self.vertices: list[NDArray[np.float64]] = []
        self.colors: list[NDArray[np.uint8] | None] = []
        self.faces: list[NDArray[np.int64]] = []
        self.face_node: list[NDArray[np.int32]] = []
        self.textures = StageTextures(path, self.time)
        self.face_texture: list[NDArray[np.int32]] = []
        self.corner_uv: list[NDArray[np.float64]] = []
        self.vertex_count = self.face_count = 0

    def add(self, prim: Prim) -> None:
        """Append one mesh in the stage's frame."""
        from pxr import UsdGeom

        mesh, where = UsdGeom.Mesh(prim), f"{self.path}: {prim.GetPath()}"
        points = np.array(mesh.GetPointsAttr().Get(self.time) or (), dtype=np.float64).reshape(-1, 3)
        corners = np.array(mesh.GetFaceVertexCountsAttr().Get(self.time) or (), dtype=np.int64)
        index = np.array(mesh.GetFaceVertexIndicesAttr().Get(self.time) or (), dtype=np.int64)
        if (corners < 0).any() or corners.sum() != len(index):
            raise FormatError(f"{where}: faceVertexCounts ask for {corners.sum()} indices, there are {len(index)}")
        if len(index) and (index.min() < 0 or index.max() >= len(points)):
            raise FormatError(f"{where}: a face uses vertex {index.max() if index.min() >= 0 else index.min()} "
                              f"of {len(points)}")  # fmt: skip
        self.face_count += int(np.maximum(corners - 2, 0).sum())
        check_face_count(self.path, self.face_count)
        check_vertex_count(self.path, self.vertex_count + len(points))
        stage_from_mesh = np.array(self.frames.GetLocalToWorldTransform(prim)).T  # their matrices act on rows
        corner, polygon = _triangles(points, corners, index)
        mirrored = np.linalg.det(stage_from_mesh[:3, :3]) < 0
        if mirrored != (mesh.GetOrientationAttr().Get() == UsdGeom.Tokens.leftHanded):
            corner = corner[:, ::-1]
        faces = index[corner]
        self.faces.append(faces + self.vertex_count)
        self.face_node.append(np.full(len(faces), len(self.names), dtype=np.int32))
        self.names.append(str(prim.GetPath()).lstrip("/"))
        texture, uv = self.textures.of(prim, polygon, corner, index, len(points))
        self.face_texture.append(texture)
        self.corner_uv.append(uv)
        textured = bool((texture >= 0).any())  # the material's colour is used, not displayColor
        white = np.full((len(points), 3), 255, np.uint8)
        self.colors.append(white if textured else self._colors(prim, corners, index, len(points)))
        self.vertices.append(points @ stage_from_mesh[:3, :3].T + stage_from_mesh[:3, 3])
        self.vertex_count += len(points)

    def _colors(
        self, prim: Prim, corners: NDArray[np.int64], index: NDArray[np.int64], count: int
    ) -> NDArray[np.uint8] | None:
        """displayColor at the vertices: the mean if faces or their corners have their own colours."""
        from pxr import UsdGeom

        primvar = UsdGeom.PrimvarsAPI(prim).FindPrimvarWithInheritance("displayColor")
        value = primvar.ComputeFlattened(self.time) if primvar and primvar.HasValue() else None
        shades = srgb_from_linear(np.clip(np.array(value or (), dtype=np.float64).reshape(-1, 3), 0.0, 1.0))
        if len(shades) == 1:
            return np.repeat(shades, count, axis=0)
        if len(shades) == count:
            return shades
        owner = {len(corners): np.repeat(np.arange(len(corners)), corners), len(index): np.arange(len(index))}
        if len(shades) not in owner or not len(shades):
            return None
        each = shades[owner[len(shades)]].astype(np.float64)
        uses = np.maximum(np.bincount(index, minlength=count), 1)
        mean = np.stack([np.bincount(index, each[:, i], minlength=count) / uses for i in range(3)], axis=1)
        return np.rint(mean).astype(np.uint8)

    def arrays(self) -> dict[str, NDArray[np.generic]]:
        """All collected meshes as one."""
        arrays: dict[str, NDArray[np.generic]] = {
            "vertices": np.concatenate(self.vertices), "faces": np.concatenate(self.faces),
            "face_node": np.concatenate(self.face_node), "names": np.array(self.names),
        }  # fmt: skip
        if any(c is not None for c in self.colors):
            arrays["colors"] = np.concatenate([
                np.full((len(v), 3), GREY, np.uint8) if c is None else c
                for v, c in zip(self.vertices, self.colors, strict=True)
            ])  # fmt: skip
        if self.textures.images:
            arrays["face_texture"], arrays["corner_uv"] = (
                np.concatenate(self.face_texture),
                np.concatenate(self.corner_uv),
            )
            arrays["wraps"] = np.array(self.textures.wraps)
            for number, image in enumerate(self.textures.images):
                arrays[f"image_{number}"] = np.frombuffer(image, dtype=np.uint8)
        return arrays


def _triangles(
    points: NDArray[np.float64], corners: NDArray[np.int64], index: NDArray[np.int64]
) -> tuple[NDArray[np.int64], NDArray[np.int64]]:
    """Triangles of polygons of any size, in order: their corners as indices into the corners of all polygons (t, 3),
    and the polygon of each triangle (t,)."""
    start = np.cumsum(corners) - corners
    faces, owners = [np.zeros((0, 3), dtype=np.int64)], [np.zeros(0, dtype=np.int64)]
    for count in np.unique(corners[corners > 2]).tolist():
        mine = np.flatnonzero(corners == count)
        polygons = start[mine][:, None] + np.arange(count)
        triples, owner = triangulate(points, index[polygons])
        faces.append(np.take_along_axis(polygons[owner], triples, axis=1))
        owners.append(mine[owner])
    owner = np.concatenate(owners)
    order = np.argsort(owner, kind="stable")
    return np.concatenate(faces)[order], owner[order]


if __name__ == "__main__":
    sys.exit(main(Path(sys.argv[1]), int(sys.argv[2]), int(sys.argv[3])))
