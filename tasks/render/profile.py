"""A cut through the contact: the support before and after, and the object in it.

In: scene before and after, the object at rest, a point and a direction. Out: a drawing of the vertical plane there.
"""

import numpy as np
from numpy.typing import NDArray

from dcap.scene.types.mesh import Mesh
from tasks.render.drawing import drawing

Array = NDArray[np.float64]

REACH = 0.8
"""Half of the width of the cut over the object's diagonal [-]."""
OVER = 1.08
"""Height of the picture over that of the object's top [-]."""
WIDTH, HEIGHT, DPI = 1024, 640, 100
BEFORE, AFTER, THING = "#8a8a8a", "#1f77b4", "#e6550d"


def profile_picture(before: Mesh, after: Mesh, thing: Mesh, middle: Array, along: Array) -> NDArray[np.uint8]:
    """The cut as a picture (h, w, 3).

    Args:
        before: the scene undeformed.
        after: the scene at rest.
        thing: the object at rest.
        middle: a point of the plane, of the contact [m], shape (3,).
        along: direction of the plane's horizontal axis, shape (3,).
    """
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.collections import LineCollection
    from matplotlib.figure import Figure

    level = np.array([along[0], along[1], 0.0])
    level /= np.linalg.norm(level)
    normal = np.array([-level[1], level[0], 0.0])
    shape = (0.78 * HEIGHT) / (0.88 * WIDTH)
    top = float(thing.bounds[1, 2] - middle[2])
    reach = max(REACH * float(np.linalg.norm(np.ptp(thing.vertices, axis=0))), OVER * top / (1.4 * shape))
    figure = Figure(figsize=(WIDTH / DPI, HEIGHT / DPI), dpi=DPI, facecolor="white")
    canvas = FigureCanvasAgg(figure)
    axes = figure.add_axes((0.09, 0.11, 0.88, 0.78))
    cut = section(after, middle, level, normal, reach)
    was = cut if before is after else section(before, middle, level, normal, reach)
    for found, color, style, width, name in (
        (cut, AFTER, "-", 2.2, "support at rest"),
        (was, BEFORE, (0, (5, 3)), 1.4, "support before"),
        (section(thing, middle, level, normal, reach), THING, "-", 2.2, "object"),
    ):
        lines = 1e3 * found
        axes.add_collection(LineCollection(list(lines), colors=color, linestyles=style, linewidths=width, label=name))
    axes.set_xlim(-1e3 * reach, 1e3 * reach)
    half = 1e3 * reach * shape
    axes.set_ylim(-0.6 * half, 1.4 * half)
    axes.set_aspect("equal")
    axes.set_xlabel("along the cut [mm]")
    axes.set_ylabel("height over the contact's middle [mm]")
    axes.grid(color="#e5e5e5", linewidth=0.8)
    axes.set_axisbelow(True)
    figure.legend(loc="upper center", ncols=3, frameon=False)
    return drawing(canvas)


def section(mesh: Mesh, middle: Array, level: Array, normal: Array, reach: float) -> Array:
    """Cut of a vertical plane through a mesh near a point: lines (k, 2, 2), along the plane and upwards from there
    [m]."""
    # one bit per vertex for each side of the box that it is beyond: a face whose corners share one is outside
    beyond = np.concatenate([mesh.vertices < middle - 2.0 * reach, mesh.vertices > middle + 2.0 * reach], axis=1)
    sides = beyond @ (1 << np.arange(6)).astype(np.uint8)
    near = np.flatnonzero(np.bitwise_and.reduce(sides[mesh.faces], axis=1) == 0)
    if not len(near):
        return np.zeros((0, 2, 2))
    import trimesh  # takes a quarter of a second, which cached results need not wait for

    part = trimesh.Trimesh(mesh.corners(near).reshape(-1, 3), np.arange(3 * len(near)).reshape(-1, 3), process=False)
    found = trimesh.intersections.mesh_plane(part, normal, middle)  # type: ignore[no-untyped-call]
    lines = np.asarray(found).reshape(-1, 2, 3) - middle
    return np.stack([lines @ level, lines[..., 2]], axis=2)
