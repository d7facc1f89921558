"""The meshes of a USD stage, read by Pixar's library: run as a process of its own by `dcap.scene.readers.usd.usd`.

    python usd_stage.py FILE CPU_SECONDS BYTES > arrays.npz, or one line of JSON with exit code 3

Subdivision surfaces are read as their cages; spheres and other shapes by formula are left out.
Source: Pixar, "USD Geom schema": Mesh, Primvar, stage metadata `upAxis` and `metersPerUnit`.
"""

import io
import json
import resource
import sys
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dcap.scene.errors import FormatError, InputError
from dcap.scene.readers.mesh.polygons import triangulate
from dcap.scene.readers.mesh.raw import check_face_count, check_vertex_count
from dcap.scene.readers.usd.usd_textures import StageTextures
from dcap.scene.srgb import srgb_from_linear

Stage = Any
Prim = Any
"""Object of that name in the library, which has no types."""

REFUSED = 3
"""Exit code where a line says what is wrong."""

FLATTEN = "flatten it into one file: `usdcat --flatten in.usd -o out.usdc`"

GREY = 200
"""Of meshes without a colour next to others that have one [sRGB]."""


def main(path: Path, cpu_seconds: int, memory: int) -> int:
    """Write the arrays, or what is wrong, to standard output."""
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
    """Every mesh of a stage; helpers and what is hidden only where there is nothing else."""
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
    """The composed stage; what it refers to must be there."""
    from pxr import Usd

    stage = Usd.Stage.Open(str(path))
    errors = stage.GetCompositionErrors()
    if errors:
        raise FormatError(f"{path}: {_first_line(errors[0])}; {FLATTEN}")
    home = path.parent.resolve()
    for layer in stage.GetUsedLayers():
        place = Path(layer.realPath.partition("[")[0])  # of a layer in a package that of the package
        if layer.realPath and not place.resolve().is_relative_to(home):
            raise FormatError(f"{path}: it refers to {place}, which lies outside of the file's folder; {FLATTEN}")
    return stage


def _first_line(error: object) -> str:
    """A message of the library in one line."""
    return " ".join(str(error).split())[:300]


def _meshes(path: Path, stage: Stage) -> list[Prim]:
    """The prims that are meshes, those within instances too."""
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
        raise InputError(f"{path}: no mesh in it: nothing to place on or to place")
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
        stage_from_mesh = np.array(self.frames.GetLocalToWorldTransform(prim)).T  # theirs act on rows
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
        textured = bool((texture >= 0).any())  # the material's colour counts, not displayColor
        white = np.full((len(points), 3), 255, np.uint8)
        self.colors.append(white if textured else self._colors(prim, corners, index, len(points)))
        self.vertices.append(points @ stage_from_mesh[:3, :3].T + stage_from_mesh[:3, 3])
        self.vertex_count += len(points)

    def _colors(
        self, prim: Prim, corners: NDArray[np.int64], index: NDArray[np.int64], count: int
    ) -> NDArray[np.uint8] | None:
        """displayColor at the vertices: the mean where faces or their corners have colours of their own."""
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
        """All of it as one mesh."""
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
    """Triangles of polygons of any size, in their order: which corners of all polygons they have (t, 3), and which
    polygon they are of (t,)."""
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
