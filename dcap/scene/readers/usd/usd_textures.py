"""Base-colour textures of a USD stage, read by Pixar's library within the process of `usd_stage`.

Read are `UsdUVTexture` nodes at the `diffuseColor` of a `UsdPreviewSurface`, with the coordinates that their
`UsdPrimvarReader_float2` names, through a `UsdTransform2d` if there is one. Only images next to the stage or within its
package count.
Source: Pixar, "UsdPreviewSurface Specification", version 2.6.
"""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dcap.scene.srgb import CLAMP, MIRROR, REPEAT, Wrap

Prim = Any
"""Object of that name in the library, which has no types."""

WRAPS = {"repeat": REPEAT, "mirror": MIRROR, "clamp": CLAMP, "black": CLAMP}
COORDINATES = "st"
"""Primvar of texture coordinates where none is named."""


@dataclass(frozen=True, eq=False)
class Texture:
    """A texture of a material."""

    slot: int
    """Index of its image and how that goes on."""
    primvar: str
    uv_from_primvar: NDArray[np.float64]
    """Shape (3, 2): rows for u, v and 1."""


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
        """Texture that is connected to the diffuse colour of a material's surface."""
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
        """Slot of an image; None where it is not there, or lies elsewhere than the stage."""
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
        """Texture coordinates at each corner of the polygons, shape (c, 2); None where the mesh has none."""
        from pxr import UsdGeom

        primvar = UsdGeom.PrimvarsAPI(prim).FindPrimvarWithInheritance(name)
        value = primvar.ComputeFlattened(self.time) if primvar and primvar.HasValue() else None
        uv = np.array(value or (), dtype=np.float64)
        if uv.ndim != 2 or uv.shape[1] != 2 or len(uv) not in (len(index), points):
            return None
        return uv if primvar.GetInterpolation() == UsdGeom.Tokens.faceVarying and len(uv) == len(index) else uv[index]


def _source(node: Any, name: str) -> Any:
    """The shader that an input of a shader is connected to; None where there is none."""
    from pxr import UsdShade

    found = node.GetInput(name)
    sources = found.GetConnectedSources()[0] if found else []
    return UsdShade.Shader(sources[0].source.GetPrim()) if sources else None


def _value(node: Any, name: str) -> Any:
    """The value of an input, its own or that of what it is connected to; None where there is none."""
    found = node.GetInput(name)
    attributes = found.GetValueProducingAttributes() if found else []
    return attributes[0].Get() if attributes else None


def _transform(node: Any) -> NDArray[np.float64]:
    """Coordinates scaled, turned, moved: rows for u, v and 1, shape (3, 2)."""
    scale, angle = _value(node, "scale") or (1.0, 1.0), np.radians(float(_value(node, "rotation") or 0.0))
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    move = np.array(_value(node, "translation") or (0.0, 0.0), dtype=np.float64)
    return np.vstack([np.diag(np.array(scale, dtype=np.float64)) @ turn, move])
