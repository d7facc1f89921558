"""The contact from nearby, with the object lifted out of the way: dent and patch, and a legend that explains them.

In: the scene at rest with its displacement, the contact and a camera. Out: a picture with a legend below it.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_closing, binary_erosion

from dcap.geometry.rendering.coverage import silhouette
from dcap.geometry.rendering.picture import Exposure
from dcap.geometry.rendering.see_through import caster_of
from dcap.scene.types.paint import PaintedMesh
from solver.certificate import ContactRow
from tasks.render.drawing import drawing
from tasks.render.patch import near_patch

Array = NDArray[np.float64]
Bytes = NDArray[np.uint8]
Mask = NDArray[np.bool_]

SHALLOWEST = 2e-4
"""Depth below which a dent is not coloured [m]."""
FADING = 0.2
"""Share of the deepest dent below which the colours fade out: the wide, shallow rim hides nothing [-]."""
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


def contact_picture(
    exposure: Exposure, shift: Array, thing: PaintedMesh, contact: Array, rows: Sequence[ContactRow], own: str,
    labels: Mapping[str, str],
) -> Bytes:  # fmt: skip
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
    """A picture (h, w, 3) whose median grey over the scene's pixels (h, w) is LEAST_GREY or lighter: on a black sofa
    neither the map's colours nor the outline would be visible."""
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
    """A mask with gaps of a few pixels between its points closed."""
    if not mask.any():
        return mask
    rim = 3 * steps
    return np.asarray(binary_closing(np.pad(mask, rim), iterations=2 * steps)[rim:-rim, rim:-rim])


def drawn(rgb: Array, mask: Mask, width: int) -> None:
    """Tint a mask in a picture and outline it."""
    line = mask & ~binary_erosion(mask, iterations=width)
    share = np.where(line, LINE_SHARE, np.where(mask, PATCH_SHARE, 0.0))[..., None]
    rgb += share * (PATCH - rgb)


def legend(rows: Sequence[ContactRow], own: str, labels: Mapping[str, str], deepest: float, width: int) -> Bytes:
    """Meaning of the colours, and forces on the object, as a strip of a picture (h, width, 3)."""
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    touching = [row for row in rows if own in (row.a, row.b)]
    lines = [carried_by(row, own, labels) for row in touching[:3]]
    if len(touching) > 3:
        lines.append(f"and {len(touching) - 3} more contacts")
    scale = width / 1024
    first = 4 if deepest > SHALLOWEST else 2  # below the colours, as the support may have a long name
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
