"""One instance in the frame of its own box, the representation used by part rules.

x and y run along the box's horizontal axes from its middle, z from its bottom; all in metres. A `SurfacePiece` is a
connected patch of faces with its extents. Rules name whole pieces that are a single part, and individual faces where a
fused scan makes one piece of several parts.

Facing of a thing without a backrest: away from the wall against which it stands.

The result of a part rule: a name per face and the direction of the front.
"""

from dataclasses import dataclass, field, replace
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from dcap.geometry.segmentation.faces import FaceTable, pairs_among, renumbered, surface_points
from dcap.geometry.segmentation.labels import Category, category_of
from dcap.geometry.segmentation.oversegmentation import color_regions, convex_pieces, merged_crumbs
from dcap.scene.types.boxes import OrientedBox
from dcap.scene.types.segmentation import Instance

UPWARD = 0.75
"""Least normal z of an upward face: within 41 degrees, so that noise of a scan does not matter [-]."""


FUSED = 0.7
"""Share of a component's area below which an instance was fused with others by the scan [-]."""

DENSE_FACES = 2000
"""Least number of faces of a body that is a scan or finely modelled [-]."""

SPECK_FACES = 16
"""Number of faces below which loose patches are fragments of a scan, not things [-]."""

MAP_CELLS = 64
"""Cells of the height map along the longer side of an instance [-]."""
AGAINST = 0.25
"""Largest distance between a thing and the wall against which it stands [m]."""

SMALLEST = 0.4
"""Size below which a thing of unknown kind turns no side to the wall [m]."""

WITHOUT_FRONT = frozenset({Category.LAMP, Category.STOOL, Category.FLAT, Category.STRUCTURE, Category.PLANT})
"""Categories without a front."""


@dataclass(frozen=True, eq=False, slots=True)
class SurfacePiece:
    """A connected patch of an instance."""

    index: int
    faces: NDArray[np.int64]
    """Indices of the faces within the surface."""
    low: NDArray[np.float64]
    """Lower extent [m], shape (3,)."""
    high: NDArray[np.float64]
    """Upper extent [m], shape (3,)."""
    area: float
    """Area [m^2]."""
    up_area: float
    """Upward area [m^2]."""

    @property
    def size(self) -> NDArray[np.float64]:
        """Extents [m], shape (3,)."""
        return self.high - self.low

    @property
    def middle(self) -> NDArray[np.float64]:
        """Centre of the extents [m], shape (3,)."""
        return 0.5 * (self.low + self.high)


@dataclass(frozen=True, eq=False, slots=True)
class InstanceSurface:
    """The faces of one instance in its box frame."""

    corners: NDArray[np.float64]
    """Corners of the faces [m], shape (k, 3, 3)."""
    center: NDArray[np.float64]
    """Centres of the faces [m], shape (k, 3)."""
    normal: NDArray[np.float64]
    area: NDArray[np.float64]
    lab: NDArray[np.float64]
    pairs: NDArray[np.int64]
    """Neighbouring faces, as indices within the surface, shape (e, 2)."""
    piece: NDArray[np.int64]
    """Index of the piece of each face, shape (k,)."""
    size: NDArray[np.float64]
    """Extents of the instance [m], shape (3,)."""
    frame: OrientedBox
    """The box that defines the frame."""
    open_up: NDArray[np.bool_]
    """Mask of the upward faces with nothing of the instance above them, shape (k,)."""

    @property
    def up(self) -> NDArray[np.bool_]:
        """Mask of the upward faces, shape (k,)."""
        return np.asarray(self.normal[:, 2] > UPWARD)

    @property
    def down(self) -> NDArray[np.bool_]:
        """Mask of the downward faces, shape (k,)."""
        return np.asarray(self.normal[:, 2] < -UPWARD)

    def pieces(self) -> list[SurfacePiece]:
        """All pieces with their extents, largest area first."""
        order = np.argsort(self.piece, kind="stable")
        starts = np.searchsorted(self.piece[order], np.arange(int(self.piece.max(initial=-1)) + 2))
        found = [self._piece(i, order[a:b]) for i, (a, b) in enumerate(pairwise(starts))]
        return sorted(found, key=lambda p: -p.area)

    def _piece(self, index: int, faces: NDArray[np.int64]) -> SurfacePiece:
        points = self.corners[faces].reshape(-1, 3)
        # Spikes of a scan: the outermost half per cent of many corners has no meaning.
        low, high = np.percentile(points, [0.5, 99.5], axis=0) if len(faces) > 200 else (points.min(0), points.max(0))
        up_area = float(self.area[faces][self.up[faces]].sum())
        return SurfacePiece(index, faces, low, high, float(self.area[faces].sum()), up_area)

    def with_pieces(self, piece: NDArray[np.int64]) -> "InstanceSurface":
        """The same instance divided differently."""
        return replace(self, piece=renumbered(piece))

    def split_by_color(self, faces: NDArray[np.int64], *, smallest: float = 0.01) -> "InstanceSurface":
        """The same instance with the given faces divided into patches of one colour each."""
        pairs = pairs_among(self.pairs, faces, len(self.area))
        region = color_regions(self.lab[faces], self.area[faces], pairs, smallest=smallest)
        piece = self.piece.copy()
        piece[faces] = int(self.piece.max()) + 1 + region
        return self.with_pieces(piece)


def instance_surface(table: FaceTable, faces: NDArray[np.int64], box: OrientedBox) -> InstanceSurface:
    """The given faces in the frame of `box`; pieces are connected components, crumbs of noise joined to neighbours."""
    pairs = pairs_among(table.pairs, faces, len(table.area))
    corners = box.to_local(table.corners[faces].reshape(-1, 3))
    corners[:, 2] += box.half_extents[2]
    corners = corners.reshape(-1, 3, 3)
    area = table.area[faces]
    piece = merged_crumbs(renumbered(_pieces(table, faces, area)), area, pairs, smallest=1e-4)
    piece = _without_specks(piece, corners.mean(axis=1))
    is_open, highest = _open_above(corners, area)
    normal = table.normal[faces] @ box.axes
    normal *= _outward(normal, table.component[faces], highest)[:, None]
    return InstanceSurface(
        corners=corners, center=corners.mean(axis=1), normal=normal, area=area,
        lab=table.lab[faces], pairs=pairs, piece=piece, size=2.0 * box.half_extents, frame=box,
        open_up=(normal[:, 2] > UPWARD) & is_open,
    )  # fmt: skip


def _outward(
    normal: NDArray[np.float64], component: NDArray[np.int64], highest: NDArray[np.int64]
) -> NDArray[np.float64]:
    """-1 for faces of components that are wound inwards, else 1, shape (k,): from above the upper sides of level faces
    are visible. For a component without level faces the rest of the thing decides."""
    level = highest[np.abs(normal[highest, 2]) > UPWARD]
    number = renumbered(component)
    vote = np.bincount(number[level], np.sign(normal[level, 2]), int(number.max(initial=-1)) + 1)
    return np.where(vote == 0.0, vote.sum() < 0.0, vote < 0.0)[number] * -2.0 + 1.0


def _pieces(table: FaceTable, faces: NDArray[np.int64], area: NDArray[np.float64]) -> NDArray[np.int64]:
    """Index of the piece of each face, shape (k,): components, with those that reach far beyond these faces cut in
    grooves."""
    component = table.component[faces]
    count = int(table.component.max(initial=-1)) + 1
    inside = np.bincount(component, area, count)
    fused = (inside < FUSED * np.bincount(table.component, table.area, count))[component]
    piece = component.copy()
    if fused.any():
        piece[fused] = count + convex_pieces(table, faces[fused])
    return piece


def _without_specks(piece: NDArray[np.int64], center: NDArray[np.float64]) -> NDArray[np.int64]:
    """Pieces where, in a dense scan, loose patches of a few faces belong to the nearest piece, shape (k,)."""
    speck = np.bincount(piece)[piece] < SPECK_FACES
    if len(piece) < DENSE_FACES or not speck.any() or speck.all():
        return piece
    nearest = cKDTree(center[~speck]).query(center[speck])[1]
    result = piece.copy()
    result[speck] = piece[~speck][nearest]
    return renumbered(result)


def _open_above(corners: NDArray[np.float64], area: NDArray[np.float64]) -> tuple[NDArray[np.bool_], NDArray[np.int64]]:
    """Mask of the faces that are mostly the highest surface at their place, shape (k,), and the highest face at each
    place.

    Uses a height map: points on all faces, the highest per cell of a grid. A face is open if half its points are within
    a cell's width of the map.
    """
    low, size = corners.reshape(-1, 3).min(axis=0), np.ptp(corners.reshape(-1, 3), axis=0)
    cell = max(float(size[:2].max()) / MAP_CELLS, 1e-9)
    points, owner = surface_points(corners, area, 0.5 * cell)
    column = np.floor((points[:, :2] - low[:2]) / cell).astype(np.int64)
    number = column[:, 0] * (MAP_CELLS + 2) + column[:, 1]
    order = np.lexsort((points[:, 2], number))
    last = order[np.append(number[order][1:] != number[order][:-1], True)] if len(order) else order
    highest = np.full((MAP_CELLS + 2) ** 2, -np.inf)
    highest[number[last]] = points[last, 2]
    is_open = points[:, 2] > highest[number] - cell
    mostly = np.bincount(owner, is_open, len(area)) >= 0.5 * np.bincount(owner, minlength=len(area))
    return np.asarray(mostly), np.asarray(owner[last])


@dataclass(eq=False, slots=True)
class PartMap:
    """Names of the faces of one instance, filled and returned by a rule."""

    names: NDArray[np.object_]
    """Part name per face, shape (k,)."""
    confidence: float = 0.5
    """Fit of the rule to the thing, 0..1."""
    front: NDArray[np.float64] | None = None
    """Horizontal unit vector out of the front, in the instance's frame, shape (3,)."""
    separate: frozenset[str] = field(default_factory=frozenset)
    """Names whose connected patches are separate parts."""

    @classmethod
    def filled(cls, count: int, name: str) -> "PartMap":
        """All faces under one name."""
        return cls(np.full(count, name, dtype=object))


SIDES = (np.array([1.0, 0, 0]), np.array([-1.0, 0, 0]), np.array([0, 1.0, 0]), np.array([0, -1.0, 0]))
"""Outward directions of the four sides of an instance's box."""


def facing_away_from_wall(thing: Instance, walls: list[Instance]) -> NDArray[np.float64] | None:
    """Horizontal unit vector away from the nearest wall, from the longest side that stands against one."""
    small = 2.0 * float(thing.box.half_extents.max()) < SMALLEST
    if category_of(thing.label) in WITHOUT_FRONT or (small and category_of(thing.label) is Category.OTHER):
        return None
    best, found = 0.0, None
    for side in SIDES:
        axis = int(np.argmax(np.abs(side)))
        outward = thing.box.axes @ side
        middle = thing.box.center + outward * thing.box.half_extents[axis]
        if any(_near(middle, outward, wall) for wall in walls) and thing.box.half_extents[1 - axis] > best:
            best, found = float(thing.box.half_extents[1 - axis]), 0.0 - outward
    return found


def _near(point: NDArray[np.float64], outward: NDArray[np.float64], wall: Instance) -> bool:
    """Return whether a wall lies close behind a point, seen along `outward`."""
    local = wall.box.to_local(point[None])[0]
    direction = wall.box.axes.T @ outward
    axis = int(np.argmin(wall.box.half_extents[:2]))
    across = abs(float(direction[axis])) > 0.9
    beside = abs(float(local[1 - axis])) <= wall.box.half_extents[1 - axis] + AGAINST
    gap = -float(np.sign(direction[axis])) * float(local[axis]) - float(wall.box.half_extents[axis])
    return across and beside and -2.0 * wall.box.half_extents[axis] - 0.05 < gap < AGAINST
