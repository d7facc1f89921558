"""The contact in close-up with the object lifted out of the way, and a cut through it.

In: the scene before and at rest with its displacement, the object, the contact and a camera. Out: a picture with the
dent, the contact patch and a legend; a drawing of the vertical plane through the contact.
"""

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_closing, binary_erosion
from scipy.spatial import cKDTree

from dcap.arrays import Array, ByteArray, Mask
from dcap.geometry.camera import Camera
from dcap.geometry.rendering.coverage import silhouette
from dcap.geometry.rendering.painted import caster_of
from dcap.geometry.rendering.picture import Exposure
from dcap.scene.types.mesh import Mesh, PaintedMesh
from solver.certificate import ContactRow

NEXT_PIXEL = 1.0
"""Distance within which a pixel is next to the contact patch [pixel]."""
LEAST_PATCH = 1.5e-3
"""Least radius of the disc that a contact point represents [m]."""
if TYPE_CHECKING:
    from matplotlib.backends.backend_agg import FigureCanvasAgg

SHALLOWEST = 2e-4
"""Depth below which a dent is not coloured [m]."""
FADING = 0.2
"""Share of the deepest dent below which the colours fade out, so that the wide, shallow rim hides nothing [-]."""
COLORS = "viridis_r"
PATCH, OUTLINE = np.array([255.0, 122.0, 26.0]), np.array([30.0, 30.0, 30.0])
"""Colours of the contact patch and of the outline of the object above it."""
DENT_SHARE, PATCH_SHARE, LINE_SHARE = 0.7, 0.15, 0.9
"""Opacities [-]."""
GREYED = 0.6
"""Share of grey in the scene's own colours, so that the map's colours stand out [-]."""
LEAST_GREY = 120.0
"""Least median grey of the scene [0..255]."""
DPI = 100
REACH = 0.8
"""Half width of the cut over the object's diagonal [-]."""
OVER = 1.08
"""Height of the picture over the height of the object's top [-]."""
PROFILE_WIDTH, PROFILE_HEIGHT = 1024, 640
BEFORE, AFTER, THING = "#8a8a8a", "#1f77b4", "#e6550d"


def patch_radius(contact: Array) -> float:
    """Radius [m] of the disc that one contact point represents, chosen so that neighbouring discs overlap."""
    if len(contact) < 2:
        return 4.0 * LEAST_PATCH
    spacing = np.median(cKDTree(contact).query(contact, k=2)[0][:, 1])
    extent = float(np.linalg.norm(np.ptp(contact, axis=0)))
    return float(np.clip(1.6 * spacing, LEAST_PATCH, max(0.05 * extent, LEAST_PATCH)))


def near_patch(points: Array, contact: Array, camera: Camera) -> NDArray[np.bool_]:
    """Mask of the points (n, 3) that lie in the contact patch, or less than a pixel next to it, shape (n,)."""
    result = np.zeros(len(points), dtype=bool)
    if not len(contact):
        return result
    depth = float(camera.project(contact)[:, 2].min())
    radius = patch_radius(contact) + NEXT_PIXEL * max(depth, 0.0) / camera.focal
    low, high = contact.min(axis=0) - radius, contact.max(axis=0) + radius
    close = np.flatnonzero(((points >= low) & (points <= high)).all(axis=1))
    result[close] = cKDTree(contact).query(points[close], distance_upper_bound=radius, workers=-1)[0] <= radius
    return result


def drawing(canvas: "FigureCanvasAgg") -> NDArray[np.uint8]:
    """The content of a canvas as a picture, shape (h, w, 3)."""
    canvas.draw()  # type: ignore[no-untyped-call]
    return np.asarray(canvas.buffer_rgba())[..., :3].copy()  # type: ignore[no-untyped-call]


def contact_picture(
    exposure: Exposure, shift: Array, thing: PaintedMesh, contact: Array, rows: Sequence[ContactRow], own: str,
    labels: Mapping[str, str],
) -> ByteArray:  # fmt: skip
    """The scene without the object, coloured by the depth of its dent, with the patch on it and a legend.

    Args:
        exposure: the camera's view in low light; the first mesh is the scene itself.
        shift: displacement of each vertex of the first [m], shape (n, 3).
        thing: the object, of which only the outline is drawn.
        contact: points that carry it [m], shape (k, 3).
        rows: contacts of the drop.
        own: the object's name in them.
        labels: names of the scene's things, by their ids.
    """
    import matplotlib

    camera = exposure.scene.camera
    rgb = exposure.picture().rgb.astype(np.float64)
    rgb += GREYED * (rgb.mean(axis=2, keepdims=True) - rgb)
    rgb = lightened(rgb, (exposure.surface.mesh_index == 0).reshape(exposure.shape))
    depth = -dents(shift, exposure)
    deepest = float(depth.max(initial=0.0))
    if deepest > SHALLOWEST:
        dented = depth > 0.0
        bare, deep = rgb[dented], depth[dented]
        color = 255.0 * np.asarray(matplotlib.colormaps[COLORS](np.clip(deep / deepest, 0.0, 1.0)))[..., :3]
        share = np.clip(deep / (FADING * deepest), 0.0, 1.0)[..., None] * DENT_SHARE
        light = bare.mean(axis=1, keepdims=True) / 160.0  # the relief stays readable under the colours
        rgb[dented] = bare + share * (np.clip(color * light, 0.0, 255.0) - bare)
    surface = exposure.surface
    seen = np.flatnonzero(surface.mesh_index == 0)
    touching = np.zeros(exposure.shape[0] * exposure.shape[1], dtype=bool)
    if len(contact):
        touching[seen] = near_patch(surface.position[:, seen].T.astype(np.float64), contact, camera)
    width = max(1, round(camera.width / 400))
    drawn(rgb, joined(touching.reshape(exposure.shape), width), width)
    rim = silhouette(caster_of([thing]), camera, 1) > 0.5
    rgb[rim & ~binary_erosion(rim, iterations=width)] = OUTLINE
    picture = np.asarray(np.round(np.clip(rgb, 0.0, 255.0)), dtype=np.uint8)
    return np.concatenate([picture, legend(rows, own, labels, deepest, camera.width)])


def lightened(rgb: Array, scene: Mask) -> Array:
    """A picture (h, w, 3) lightened so that its median grey over the scene's pixels (h, w) is at least LEAST_GREY: on a
    black sofa neither the map's colours nor the outline would be visible."""
    level = float(np.median(rgb[scene].mean(axis=1))) if scene.any() else 255.0
    if level >= LEAST_GREY:
        return rgb
    gamma = np.log(LEAST_GREY / 255.0) / np.log(max(level, 1.0) / 255.0)
    return np.asarray(255.0 * (rgb / 255.0) ** gamma)


def dents(shift: Array, exposure: Exposure) -> NDArray[np.float32]:
    """Displacement of the first mesh along its outward normal [m], shape (h, w)."""
    surface = exposure.surface
    result = np.zeros(len(surface.face), dtype=np.float32)
    faces = exposure.scene.prepared.mesh.faces
    shifted = np.zeros(len(exposure.scene.prepared.mesh.vertices), dtype=bool)
    shifted[: len(shift)] = shift.any(axis=1)  # the first mesh's vertices come first
    bent = np.asarray(shifted[faces].any(axis=1))
    mine = np.flatnonzero((surface.mesh_index == 0) & bent[surface.face])
    corner = faces[surface.face[mine]]
    moved = np.einsum("kn,nki->in", surface.corner_weights[:, mine], shift[corner])
    result[mine] = np.einsum("in,in->n", moved, surface.flat[:, mine])
    return result.reshape(exposure.shape)


def joined(mask: Mask, steps: int) -> Mask:
    """A mask in which gaps of a few pixels between its points are closed."""
    if not mask.any():
        return mask
    rim = 3 * steps
    return np.asarray(binary_closing(np.pad(mask, rim), iterations=2 * steps)[rim:-rim, rim:-rim])


def drawn(rgb: Array, mask: Mask, width: int) -> None:
    """Tint a mask in a picture and outline it."""
    line = mask & ~binary_erosion(mask, iterations=width)
    share = np.where(line, LINE_SHARE, np.where(mask, PATCH_SHARE, 0.0))[..., None]
    rgb += share * (PATCH - rgb)


def legend(rows: Sequence[ContactRow], own: str, labels: Mapping[str, str], deepest: float, width: int) -> ByteArray:
    """Legend of the colours, and forces on the object, as a strip of a picture (h, width, 3)."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    touching = [row for row in rows if own in (row.a, row.b)]
    lines = [carried_by(row, own, labels) for row in touching[:3]]
    if len(touching) > 3:
        lines.append(f"and {len(touching) - 3} more contacts")
    scale = width / 1024
    first = 4 if deepest > SHALLOWEST else 2  # below the colours, because the support may have a long name
    height = (0.95 + 0.24 * (max(len(lines), 1) + first - 2)) * scale
    figure = Figure(figsize=(width / DPI, height * 100 / DPI), dpi=DPI, facecolor="white")
    canvas = FigureCanvasAgg(figure)
    size = 13.0 * scale
    step = 24.0 * scale / (height * 100)
    figure.text(0.03, 1.0 - 1.3 * step, "■", color=PATCH / 255.0, size=1.2 * size)
    figure.text(0.06, 1.0 - 1.3 * step, "where it touches", size=size)
    figure.text(0.28, 1.0 - 1.3 * step, "—", color=OUTLINE / 255.0, size=1.2 * size, weight="bold")
    figure.text(0.31, 1.0 - 1.3 * step, "outline of the object", size=size)
    for number, line in enumerate(lines or ["nothing carries it"], first):
        figure.text(0.03, 1.0 - (1.3 * number) * step, line, size=size)
    if deepest > SHALLOWEST:
        axes = figure.add_axes((0.62, 1.0 - 1.5 * step, 0.34, 0.8 * step))
        axes.imshow(np.linspace(0.0, 1.0, 256)[None], aspect="auto", cmap=COLORS, extent=(0.0, 1e3 * deepest, 0.0, 1.0))
        axes.set_yticks([])
        axes.tick_params(labelsize=0.85 * size)
        axes.set_xlabel("depth of the dent [mm]", size=size)
    else:
        figure.text(0.62, 1.0 - 1.3 * step, f"no dent deeper than {1e3 * SHALLOWEST:.1f} mm", size=size)
    return drawing(canvas)


def carried_by(row: ContactRow, own: str, labels: Mapping[str, str]) -> str:
    """One contact in words."""
    other, _, _ = (row.b if row.a == own else row.a).partition("/")
    other = labels.get(other, other)
    pressure = row.normal_force_n / row.area_m2 if row.area_m2 > 0.0 else 0.0
    kilo = f"{pressure / 1e3:.2f} kPa" if pressure >= 100.0 else f"{pressure:.1f} Pa"
    return f"on {other}: {row.normal_force_n:.2f} N over {1e4 * row.area_m2:.1f} cm², {kilo} on average"


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
    shape = (0.78 * PROFILE_HEIGHT) / (0.88 * PROFILE_WIDTH)
    top = float(thing.bounds[1, 2] - middle[2])
    reach = max(REACH * float(np.linalg.norm(np.ptp(thing.vertices, axis=0))), OVER * top / (1.4 * shape))
    figure = Figure(figsize=(PROFILE_WIDTH / DPI, PROFILE_HEIGHT / DPI), dpi=DPI, facecolor="white")
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
    """Cut of a vertical plane through a mesh near a point: line segments (k, 2, 2), along the plane and upwards from
    the point [m]."""
    # one bit per vertex for each side of the box beyond which it lies: a face whose corners share a bit is outside
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
