"""Pictures of the object over its base: the three flips, and a picture of all other poses, each with its id.

In: scene, base, mesh at its scale, poses. Out: sRGB pictures from one camera, which a model sees before it chooses.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from dcap.arrays import Array
from dcap.geometry.camera import Camera, looking_at
from dcap.geometry.placement.poses import about_z
from dcap.geometry.placement.resting_poses import FLIPS
from dcap.geometry.rendering.picture import picture
from dcap.language.protocol.requests import PoseView
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.segmentation import Instance, Segmentation
from tasks.requests.surroundings import part_frame

AXIS_COLORS = {"x": (214, 40, 40), "y": (30, 140, 50), "z": (40, 70, 210)}
SAME_SIDE = 1e-6
"""1 - cosine between the upward directions of two poses, below which they differ by a turn about the vertical."""
TILES_IN_A_ROW = 5
NEAR = 1.4
"""Distance of the camera over the diagonal of the object [-]: half the diagonal needs 0.5 / tan(27.5 degrees) =
0.96."""
PAPER, INK = (255, 255, 255), (20, 20, 24)


def three_flips(
    scene: Segmentation, base: Instance, mesh: Mesh, place: Array, size: int, around: float = 0.0
) -> tuple[NDArray[np.uint8], ...]:
    """The object over the base, flipped about x, y and z, from one camera, at the angle `around` [rad] from the
    front."""
    hover, extent = hovering(mesh, place)
    reach = max(1.8 * extent, min(0.6 * base.box.diagonal, 2.6 * extent))
    camera = camera_at(scene, base, hover - (0.0, 0.0, 0.25 * extent), reach, size, around)
    turns = [np.diag(diagonal) for diagonal in FLIPS.values()]
    shots = over_the_base(scene, base, mesh, turns, hover, camera)
    return tuple(annotated(rgb, axis, camera, hover, extent) for rgb, axis in zip(shots, FLIPS, strict=True))


def pose_strip(
    scene: Segmentation, base: Instance, mesh: Mesh, place: Array, size: int, poses: Sequence[PoseView]
) -> NDArray[np.uint8]:
    """A picture with a tile of `size` pixels for each side on which the object can lie, with the ids of the poses
    below.

    Poses that differ by a turn about the vertical share a tile, because the facing is chosen separately.
    """
    hover, extent = hovering(mesh, place)
    camera = camera_at(scene, base, hover - (0.0, 0.0, 0.1 * extent), NEAR * extent, size)
    groups = by_side(poses)
    turns = [np.array(group[0].rotation) for group in groups]
    shots = over_the_base(scene, base, mesh, turns, hover, camera)
    return contact_sheet(shots, [[one.id for one in group] for group in groups])


def by_side(poses: Sequence[PoseView]) -> list[list[PoseView]]:
    """Poses grouped by the upward direction of the mesh, in the order of the first pose of each group."""
    groups: list[list[PoseView]] = []
    for pose in poses:
        up = np.array(pose.rotation[2])
        same = (group for group in groups if 1.0 - float(up @ group[0].rotation[2]) < SAME_SIDE)
        found = next(same, None)
        if found is None:
            groups.append([pose])
        else:
            found.append(pose)
    return groups


def contact_sheet(tiles: Sequence[NDArray[np.uint8]], captions: Sequence[Sequence[str]]) -> NDArray[np.uint8]:
    """Square pictures of the same size in rows, each with its lines of text below."""
    size = len(tiles[0])
    letters = max(12, size // 18)
    line, gap = round(1.3 * letters), max(2, size // 40)
    rows = [range(k, min(k + TILES_IN_A_ROW, len(tiles))) for k in range(0, len(tiles), TILES_IN_A_ROW)]
    heights = [size + line * max(len(captions[k]) for k in row) + 2 * gap for row in rows]
    image = Image.new("RGB", (gap + min(len(tiles), TILES_IN_A_ROW) * (size + gap), gap + sum(heights)), PAPER)
    draw, font = ImageDraw.Draw(image), ImageFont.load_default(size=letters)
    top = gap
    for row, height in zip(rows, heights, strict=True):
        for column, k in enumerate(row):
            left = gap + column * (size + gap)
            image.paste(Image.fromarray(tiles[k]), (left, top))
            for number, text in enumerate(captions[k]):
                draw.text((left, top + size + number * line), text, fill=INK, font=font)
        top += height
    return np.asarray(image, dtype=np.uint8).copy()


def hovering(mesh: Mesh, place: Array) -> tuple[Array, float]:
    """Middle of the object above its place, as shown [m], shape (3,), and the diagonal of its box [m]."""
    extent = float(np.linalg.norm(np.ptp(mesh.bounds, axis=0)))
    return place + np.array([0.0, 0.0, 0.65 * extent]), extent


def over_the_base(
    scene: Segmentation, base: Instance, mesh: Mesh, turns: Sequence[Array], hover: Array, camera: Camera
) -> list[NDArray[np.uint8]]:
    """A picture of the object for each rotation, shape (3, 3), about its middle, over the fixed base."""
    support = scene.instance_mesh(scene.index_of(base.id))
    middle = mesh.bounds.mean(axis=0)
    shots = []
    for turn in turns:
        pose = np.eye(4)
        pose[:3, :3] = turn
        pose[:3, 3] = hover - turn @ middle
        shots.append(picture([support, mesh.transformed(pose)], camera, samples=1).rgb)
    return shots


def camera_at(
    scene: Segmentation, base: Instance, target: Array, reach: float, size: int, around: float = 0.0
) -> Camera:
    """Camera at `reach` [m] from its target, slightly above and to the right of the viewer's side turned by `around`
    [rad]."""
    frame = part_frame(scene, base, base.box)
    direction = about_z(around) @ np.array([*(0.9 * frame.front + 0.35 * frame.right), 0.5])
    direction /= np.linalg.norm(direction)
    return looking_at(target + reach * direction, target, size, size)


def annotated(rgb: NDArray[np.uint8], axis: str, camera: Camera, center: Array, extent: float) -> NDArray[np.uint8]:
    """The picture with the name of the flip, and its axis drawn through the object."""
    image = Image.fromarray(rgb)
    draw = ImageDraw.Draw(image)
    unit = np.eye(3)["xyz".index(axis)]
    color = AXIS_COLORS[axis]
    width = max(2, image.width // 170)
    ends = inside(camera.project(center + np.outer([-0.75 * extent, 0.75 * extent], unit))[:, :2], image, 9 * width)
    draw.line([tuple(ends[0]), tuple(ends[1])], fill=color, width=width)
    arrow_head(draw, ends[0], ends[1], color, 5 * width)
    turn_mark(draw, 0.5 * ends[0] + 0.5 * ends[1], ends[1] - ends[0], color, width)
    font = ImageFont.load_default(size=max(12, image.width // 22))
    text = f"flipped 180\N{DEGREE SIGN} about {axis}"
    box = draw.textbbox((0, 0), text, font=font)
    draw.rectangle([0, 0, box[2] + 16, box[3] + 12], fill=(255, 255, 255))
    draw.text((8, 4), text, fill=color, font=font)
    tip = ends[1] + 7 * width * (ends[1] - ends[0]) / max(float(np.linalg.norm(ends[1] - ends[0])), 1e-6)
    draw.text((float(tip[0]), float(tip[1])), axis, fill=color, font=font, anchor="mm")
    return np.asarray(image, dtype=np.uint8).copy()


def inside(ends: Array, image: Image.Image, margin: int) -> Array:
    """A line with both ends (2, 2) moved towards its middle until it lies in the picture [pixels]."""
    middle, half = ends.mean(axis=0), 0.5 * (ends[1] - ends[0])
    room = np.minimum(middle, np.array(image.size) - middle) - margin
    share = min(1.0, float((np.maximum(room, 1.0) / np.maximum(np.abs(half), 1e-6)).min()))
    return np.array([middle - share * half, middle + share * half])


def arrow_head(draw: ImageDraw.ImageDraw, start: Array, end: Array, color: tuple[int, int, int], size: int) -> None:
    """A filled triangle at the end of a line."""
    along = (end - start) / max(float(np.linalg.norm(end - start)), 1e-6)
    across = np.array([-along[1], along[0]])
    corners = [end + size * along, end + 0.5 * size * across, end - 0.5 * size * across]
    draw.polygon([tuple(c) for c in corners], fill=color)


def turn_mark(draw: ImageDraw.ImageDraw, center: Array, axis: Array, color: tuple[int, int, int], width: int) -> None:
    """Half an ellipse with an arrow head around the axis: the direction of the flip."""
    along = axis / max(float(np.linalg.norm(axis)), 1e-6)
    across = np.array([-along[1], along[0]])
    radius = 9 * width
    angle = np.radians(np.linspace(20, 200, 25))
    ring = center + radius * (np.cos(angle)[:, None] * across + 0.35 * np.sin(angle)[:, None] * along)
    draw.line([tuple(p) for p in ring], fill=color, width=width)
    arrow_head(draw, ring[-3], ring[-1], color, 4 * width)
