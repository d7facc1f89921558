"""Content of a mesh file, before units, axes and colours are settled.

`RawMesh` is what every format reader returns; `paint.py` next to this bakes its textures and `frame.py`
brings it to metres and z up. Invariant: finite vertices, indices in range, at least one face.
"""

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from dcap.scene.errors import FormatError, InputError
from dcap.scene.types.paint import Paint

MAX_FACES = 4_000_000
"""Faces that a file may hold [-]. Reading and cleaning take 0.5 KB for a plain face and 1.6 KB for a textured one at
the peak (measured on a million): 6.4 GB at worst, which a machine of 8 GiB has. SuGaR's largest meshes have half as
many."""

MAX_CORNERS = 3 * MAX_FACES
"""Vertices, or values of one accessor, that a file may hold [-]: no face shares a corner with another."""


@dataclass(frozen=True, eq=False, slots=True)
class RawMesh:
    """Triangles in the file's own units and axes."""

    path: Path
    """The file, for messages."""
    vertices: NDArray[np.float64]
    """Positions [file units], shape (n, 3)."""
    faces: NDArray[np.int64]
    """Counter-clockwise vertex indices, shape (m, 3)."""
    colors: NDArray[np.uint8] | None
    """sRGB vertex colours, shape (n, 3)."""
    paint: Paint | None
    face_node: NDArray[np.int32]
    """Index into `node_names`, -1 for none, shape (m,)."""
    node_names: tuple[str, ...]
    """Names; an ancestor and its descendant are joined by '/'."""
    up: str
    """Up axis by the format's standard: y or z; empty if the format has none."""
    unit_metres: float
    """Length unit by the format's standard [m]; 0 if the format has none."""
    notes: tuple[str, ...]
    node_labels: tuple[str | None, ...] = ()
    """Label that each node's instance is annotated with, as in `Scan`; empty: the file annotates nothing."""
    of_splats: bool = False
    """Faces that only stand for Gaussians: they tell where and which way, not which side is out."""

    def __post_init__(self) -> None:
        if not len(self.vertices) or not len(self.faces):
            raise InputError(f"{self.path}: no faces ({len(self.vertices)} vertices): nothing to place on or to place")
        if not np.isfinite(self.vertices).all():
            bad = np.flatnonzero(~np.isfinite(self.vertices).all(axis=1))
            more = f" ({len(bad) - 1} more like it)" if len(bad) > 1 else ""
            raise FormatError(f"{self.path}: vertex {bad[0]} is not finite: {self.vertices[bad[0]].tolist()}{more}")
        low, high = int(self.faces.min()), int(self.faces.max())
        if low < 0 or high >= len(self.vertices):
            raise FormatError(
                f"{self.path}: a face uses vertex {low if low < 0 else high}, the file has {len(self.vertices)}"
            )
        self._check_area()

    def without_loose_vertices(self) -> "RawMesh":
        """Without vertices that no face uses: they are no surface, but would count in the size of the thing."""
        used = np.zeros(len(self.vertices), dtype=bool)
        used[self.faces] = True
        if used.all():
            return self
        colors = None if self.colors is None else self.colors[used]
        place = np.cumsum(used) - 1
        return replace(self, vertices=self.vertices[used], faces=place[self.faces], colors=colors)

    def _check_area(self) -> None:
        """Refuse a mesh without any surface: the sign of a decoder that gave up."""
        if self.degenerate.all():
            raise FormatError(f"{self.path}: all {len(self.faces)} faces have zero area")

    @property
    def degenerate(self) -> NDArray[np.bool_]:
        """Faces without area, shape (m,)."""
        a, b, c = (self.vertices[self.faces[:, i]] for i in range(3))
        twice_area = np.linalg.norm(np.cross(b - a, c - a), axis=1)
        low, high = (np.stack([end(corner, axis=0) for corner in (a, b, c)]) for end in (np.min, np.max))
        extent = float((high.max(axis=0) - low.min(axis=0)).max())
        # A sliver of relative area 1e-14 is below the rounding of float64 coordinates.
        return np.asarray(~(twice_area > 1e-14 * extent * extent))


def check_face_count(path: Path, count: int) -> None:
    """Refuse more faces than we can work with, before they are allocated."""
    if count > MAX_FACES:
        raise InputError(f"{path}: {count} faces > {MAX_FACES}; decimate the mesh first")


def check_vertex_count(path: Path, count: int) -> None:
    """Refuse more vertices than the faces that we can work with have corners."""
    if count > MAX_CORNERS:
        raise InputError(f"{path}: {count} vertices > {MAX_CORNERS}; decimate the mesh first")
