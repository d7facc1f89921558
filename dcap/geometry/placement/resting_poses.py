"""The poses in which a thing can be put down, on which ends it stands, and whether a figure sits.

In: a mesh, its standing pose by shape, and the frame to be trusted. Out: the pose of the file, its half turns and
quarter turns; the same for the pose in which the shape stands, if that differs (a lying or overturned file); and the
stable poses of the convex hull. Each has up and front of the frame from which it is turned.

Axes by which a shape lies or stands on end, determined by its extents alone.

In: a mesh. Out: the axes of its box, found from its thinnest side, and the axis that decides whether it stands on end,
lies, or has no end to stand on.

Decides from its shape whether a figure sits on its body or stands on legs.

In: a mesh and its upward axis. Out: whether it has legs, that is, more air than body right under its centre of mass;
and whether it sits: it has none under it, and the centre is nearer to its bottom than to its top, since legs are
lighter than the body that they carry.
"""

from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull, QhullError
from scipy.spatial.transform import Rotation

from dcap.arrays import Array
from dcap.geometry.placement.polygons import smallest_rectangle
from dcap.geometry.placement.poses import center_of_mass, front_of, rotated, stable_poses, turn_between
from dcap.geometry.placement.upright import FILE_DOWN, probability_of, used_vertices
from dcap.geometry.raycast import Raycaster
from dcap.scene.types.mesh import Mesh

FLIPS = {"x": (1.0, -1.0, -1.0), "y": (-1.0, 1.0, -1.0), "z": (-1.0, -1.0, 1.0)}
"""Diagonals of the half turns."""
LOW = 0.75
"""Ratio of an extent to the next longer one below which it is clearly shorter [-]."""
BLOCK = 256
"""Number of directions measured at once: a scan's hull has thousands [-]."""
LOOKS = 9
"""Number of rays from below along each side of a square about the centre of mass [-]."""
ABOUT = 0.1
"""Half the side of that square over the larger horizontal extent [-]: rays pass a crease or a tail between the legs."""
MOST = 0.5
"""Share of air below the centre of mass over its height, and height of the centre over that of the thing [-]. At one
half there is as much air as body, and as much above as below."""


@dataclass(frozen=True, eq=False, slots=True)
class RestingPose:
    """A pose in which a thing can be put down."""

    id: str
    """upright (as in the file), flip_x, on_left_side ..., righted (according to its shape), righted_flip_x ...,
    stable_0"""
    rotation: Array
    """From the mesh frame to the world, shape (3, 3)."""
    probability: float
    """Share of directions from which it comes to rest in this pose [-]; 0 if it is not stable."""
    up: Array
    """World direction of its upward axis, shape (3,)."""
    front: Array
    """World direction of its front, shape (3,)."""
    size: Array
    """Extents along world x, y, z [m], shape (3,)."""


def resting_poses(mesh: Mesh, own: Array, believed: Array, side: str) -> tuple[RestingPose, ...]:
    """All poses, with that of the file first.

    Args:
        mesh: the thing at its scale.
        own: how it stands by its shape, shape (3, 3); the identity where that is as in the file.
        believed: the frame whose up and front stable poses have, to which any frame leads, shape (3, 3).
        side: what its category says of its front, as `front_of` takes it.
    """
    stable, points = stable_poses(mesh), used_vertices(mesh)

    def pose(name: str, rotation: Array, probability: float, axes: tuple[Array, Array]) -> RestingPose:
        up, front = (rotation @ axis for axis in axes)
        return RestingPose(name, rotation, probability, up, front, np.ptp(points @ rotation.T, axis=0))

    frames = {"upright": np.eye(3)} | ({} if np.allclose(own, np.eye(3)) else {"righted": own})
    found = []
    for name, frame in frames.items():
        axes = axes_of(mesh, frame, side)
        for turned, turn in turns_of(name, frame @ axes[1]).items():
            rotation = turn @ frame
            found.append(pose(turned, rotation, probability_of(rotation.T @ FILE_DOWN, stable), axes))
    axes = axes_of(mesh, believed, side)
    found += [pose(f"stable_{k}", one.rotation, one.probability, axes) for k, one in enumerate(stable)]
    return tuple(found)


def axes_of(mesh: Mesh, frame: Array, side: str) -> tuple[Array, Array]:
    """Up and front of a mesh that stands in a frame, shape (3, 3), as unit vectors of the mesh."""
    return frame[2], frame.T @ front_of(rotated(mesh, frame), side)[0]


def turns_of(frame: str, front: Array) -> dict[str, Array]:
    """Standing, the half turns about x, y, z and the quarter turns on to sides, back and front, by id."""
    side = np.cross(front, (0.0, 0.0, 1.0))
    prefix = "" if frame == "upright" else f"{frame}_"
    quarters = {"on_left_side": -front, "on_right_side": front, "on_back": side, "on_front": -side}
    halves = {f"{prefix}flip_{axis}": np.diag(diagonal) for axis, diagonal in FLIPS.items()}
    turned = {f"{prefix}{name}": Rotation.from_rotvec(np.pi / 2 * way).as_matrix() for name, way in quarters.items()}
    return {frame: np.eye(3)} | halves | turned


def own_box(mesh: Mesh) -> tuple[Array, Array]:
    """Axes as rows (3, 3), unit, and extents (3,) [m] of the box about a mesh, the longest first.

    Its thinnest side lies on a face of the hull, the others are those of the smallest rectangle about the view along
    that side. Flat and straight meshes have boxes too.
    """
    points = np.unique(mesh.vertices[np.unique(mesh.faces)], axis=0)
    thin = thinnest(points)
    across = np.cross(thin, np.eye(3)[int(np.argmin(np.abs(thin)))])
    frame = np.stack([across / np.linalg.norm(across), np.cross(thin, across / np.linalg.norm(across))])
    long, size = smallest_rectangle(points @ frame.T)
    first = long @ frame
    axes = np.stack([first, np.cross(thin, first), thin])
    extents = np.array([*size, np.ptp(points @ thin)])
    order = np.argsort(-extents, kind="stable")
    return axes[order], extents[order]


def thinnest(points: Array) -> Array:
    """Normal of the face of the hull across which points (n, 3) are thinnest, unit, shape (3,)."""
    try:
        hull = ConvexHull(points)
    except (QhullError, ValueError):  # flat: the normal of its plane
        return np.asarray(np.linalg.svd(points - points.mean(axis=0))[2][-1])
    normals = np.unique(np.round(hull.equations[:, :3], 9), axis=0)
    outer = points[hull.vertices]
    blocks = np.array_split(normals, len(normals) // BLOCK + 1)
    widths = np.concatenate([np.ptp(block @ outer.T, axis=1) for block in blocks])
    best = normals[int(np.argmin(widths))]
    return np.asarray(best / np.linalg.norm(best))


def end_axis(mesh: Mesh, *, on_edge: bool) -> tuple[Array, float] | None:
    """The axis that decides whether the thing stands on end, and its angle from the vertical in that case [rad]; None
    if the shape has no end.

    For a long thing it is the long axis, which is then vertical; for a flat thing the thin one, which is then
    horizontal. For a thing that is both, `on_edge` says whether standing on any edge is enough.
    """
    axes, size = own_box(mesh)
    flat = (axes[2], 0.5 * np.pi) if size[2] < LOW * size[1] else None
    long = (axes[0], 0.0) if size[1] < LOW * size[0] else None
    return flat or long if on_edge else long or flat


def sits(mesh: Mesh, up: Array) -> bool:
    """Return whether a mesh with the given upward axis, a unit vector of shape (3,), sits."""
    height = used_vertices(mesh) @ up
    low, middle = float(height.min()), float(center_of_mass(mesh) @ up)
    return middle - low <= MOST * (float(height.max()) - low) and not on_legs(mesh, up)


def on_legs(mesh: Mesh, up: Array) -> bool:
    """Return whether a mesh with the given upward axis, a unit vector of shape (3,), has more air than body under its
    centre of mass."""
    turn = turn_between(up, np.array([0.0, 0.0, 1.0]))
    points, center = used_vertices(mesh) @ turn.T, turn @ center_of_mass(mesh)
    low, high = points.min(axis=0), points.max(axis=0)
    height = float(center[2] - low[2])
    steps = ABOUT * float((high - low)[:2].max()) * np.linspace(-1.0, 1.0, LOOKS)
    x, y = (grid.ravel() for grid in np.meshgrid(center[0] + steps, center[1] + steps))
    origin = np.c_[x, y, np.full(len(x), low[2] - height)]
    hits = Raycaster(mesh).cast(origin @ turn, np.tile(up, (len(origin), 1)))
    air = np.where(hits.face >= 0, hits.distance - height, np.inf)
    return bool(np.median(air) > MOST * height)
