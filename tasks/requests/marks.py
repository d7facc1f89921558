"""Numbered pictures of things in a scene ("set of marks"), and of all candidates for a support.

In: a scene and its things. Out: sRGB pictures in which each thing has its number, and one of plan and view with a list
of names, certainties, ids and sizes, so that a person can choose. Obstacles (ceiling, walls in front of the camera) are
left out. The correction page for people, the picture of a refusal and the questions to a model show the same numbers.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

from dcap.arrays import Array, IntArray, Mask
from dcap.geometry.camera import Camera, looking_at
from dcap.geometry.rendering.picture import picture
from dcap.geometry.rendering.view_volume import cut_faces
from dcap.scene.types.boxes import OrientedBox
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.segmentation import Segmentation
from tasks.requests.badges import INK, PAPER, badge_size, numbered, paint, with_rulers
from tasks.requests.pictures import best_place, from_inside

SIZE = 896
"""Width of the views of the room and longer side of the plan [pixels]."""
VIEW_SHAPE = 0.75
"""Height over width of the views [-]."""
ELEVATION_DEG = 42.0
"""Height of the camera over the horizon: into a room over its walls [degrees]."""
PLAN_FOV_DEG = 12.0
"""Narrow field of view, so that high things hardly lean outward [degrees]."""
HEAD = 1.9
"""Height above the floor from which horizontal faces of the building are its ceiling, whatever their label [m]."""
WIDE = 0.5
"""Share of the plan from which a thing is part of the room, not furniture: its ceiling is left out too [-]."""
LEVEL = 0.7
"""Least cosine to the vertical of a horizontal face [-]."""
ON_THE_FLOOR = 0.15
"""Height up to which faces decide whether floors face up [m]."""
ONE_SIDED = 0.9
"""Least share of these faces that face up for the orientation of all faces to be reliable [-]."""
RIM = 1.04
"""Share of the picture that the room fills [-]."""
CENTERED, HALVINGS = 3, 30
"""Number of times that the box is centred and that the interval of distances is halved [-]."""
THUMBNAIL = 224
"""Side length of the picture of one thing [pixels]."""
THING_DISTANCE = 1.35
"""Distance of its camera over the diagonal of its box [-]."""
NEAREST = 0.4
"""Least distance of the camera [m]."""
LETTERS, ROW, GAP = 17, 27, 14
"""Height of the letters, of a row of the list, and of the gap between pictures [pixels]."""
COLUMN = 400
"""Width of a column of the list [pixels]."""
BACKGROUND, TEXT, FAINT = (250, 250, 248), (24, 24, 28), (110, 110, 116)


@dataclass(frozen=True, eq=False, slots=True)
class Mark:
    """A thing with its number."""

    number: int
    faces: IntArray
    """Faces of the mesh, shape (k,)."""
    box: OrientedBox


@dataclass(frozen=True, eq=False, slots=True)
class MarkedScene:
    """A mesh with numbered things."""

    mesh: Mesh
    structure: Mask
    """Whether faces belong to walls, floor, ceiling, or nothing, shape (m,)."""
    marks: tuple[Mark, ...]

    @property
    def owner(self) -> IntArray:
        """Position in `marks` for each face, -1 for none, shape (m,)."""
        owner = np.full(len(self.mesh.faces), -1, dtype=np.int64)
        for index, mark in enumerate(self.marks):
            owner[mark.faces] = index
        return owner


def numbers_of(scene: Segmentation) -> Mapping[int, int]:
    """The numbers of a scene's things, 1 and up in their order, by their place among the instances; walls and ceilings
    get no number, floors do, because things are placed on them."""
    shown = [i for i, one in enumerate(scene.instances) if not one.structure or one.label == "floor"]
    return {index: number for number, index in enumerate(shown, start=1)}


def marked(scene: Segmentation, numbers: Mapping[int, int] | None = None) -> MarkedScene:
    """A scene with numbers on its instances, by default from `numbers_of`."""
    numbers = numbers_of(scene) if numbers is None else numbers
    structure = np.array([one.structure for one in scene.instances] + [True])[scene.face_instance]
    order = np.argsort(scene.face_instance, kind="stable")
    ends = np.searchsorted(scene.face_instance[order], np.arange(len(scene.instances) + 1))
    marks = (
        Mark(number, order[ends[i] : ends[i + 1]], scene.instances[i].box)
        for i, number in numbers.items()
        if ends[i + 1] > ends[i]
    )
    return MarkedScene(scene.mesh, structure, tuple(marks))


def room_pictures(scene: MarkedScene, count: int = 2, size: int = SIZE) -> list[NDArray[np.uint8]]:
    """The room over `count` of its corners, opposite ones first, each of shape (VIEW_SHAPE size, size, 3)."""
    low, high = framed(scene)
    middle = 0.5 * (low + high)
    half = 0.5 * (high - low)
    corners = [(1.0, -1.0), (-1.0, 1.0), (-1.0, -1.0), (1.0, 1.0)][:count]
    return [photograph(scene, corner_camera(middle, half, corner, size)) for corner in corners]


def plan_picture(
    scene: MarkedScene, size: int = SIZE, file_from_world: Array | None = None
) -> NDArray[np.uint8]:  # fmt: skip
    """The room from above without its ceiling, world x to the right and y up, the longer side `size` pixels.

    With `file_from_world` (4, 4), rulers on the left and below show the file's own coordinates.
    """
    camera = plan_camera(scene, size)
    shot = photograph(scene, camera)
    return shot if file_from_world is None else with_rulers(shot, camera, framed(scene), file_from_world)


def plan_camera(scene: MarkedScene, size: int) -> Camera:
    """Camera looking straight down on the whole room, from a distance at which high things hardly lean outward."""
    low, high = framed(scene)
    extent = np.maximum(high[:2] - low[:2], 1e-6)
    width, height = (max(64, round(size * float(side / extent.max()))) for side in extent)
    # the picture is as wide as the room at the height of its top, so everything lower fits into it
    distance = 0.5 * RIM * float(extent.max()) / np.tan(np.radians(0.5 * PLAN_FOV_DEG))
    fov = 2.0 * np.degrees(np.arctan(0.5 * RIM * float(extent[0]) / distance))
    middle = 0.5 * (low + high)
    position = np.array([middle[0], middle[1], high[2] + distance])
    return looking_at(position, np.array([*middle[:2], low[2]]), width, height, fov_deg=fov, up=(0.0, 1.0, 0.0))


def thumbnail(scene: MarkedScene, mark: Mark, size: int = THUMBNAIL) -> NDArray[np.uint8]:
    """One thing in its surroundings, from the place where most of it is visible, shape (size, size, 3)."""
    others = np.ones(len(scene.mesh.faces), dtype=bool)
    others[mark.faces] = False
    thing = scene.mesh.submesh(mark.faces)
    loose = scene.mesh.submesh(np.flatnonzero(others & ~scene.structure))
    distance = max(NEAREST, THING_DISTANCE * mark.box.diagonal)
    position = best_place(loose, thing, mark.box, distance, *from_inside(scene.mesh.bounds, mark.box))
    camera = looking_at(position, mark.box.center, size, size)
    kept = others & ~hidden(scene, camera)
    meshes = [scene.mesh.submesh(np.flatnonzero(kept)), thing]
    taken = picture(meshes, camera, samples=2, shadows=False)
    faded = np.where((taken.mesh_index == 1)[..., None], taken.rgb, np.rint(0.45 * taken.rgb + 0.55 * 235.0))
    return np.asarray(faded, dtype=np.uint8)


def photograph(scene: MarkedScene, camera: Camera) -> NDArray[np.uint8]:
    """A camera's view with numbers."""
    owner, kept = scene.owner, ~hidden(scene, camera)
    rest = scene.mesh.submesh(np.flatnonzero(kept & (owner < 0)))
    meshes, place = ([rest], {}) if len(rest.faces) else ([], {})
    for mark in scene.marks:
        faces = mark.faces[kept[mark.faces]]
        if len(faces):
            place[len(meshes)] = mark.number
            meshes.append(scene.mesh.submesh(faces))
    if not meshes:
        return np.full((camera.height, camera.width, 3), 255, dtype=np.uint8)
    taken = picture(meshes, camera, samples=1, shadows=False)
    return numbered(taken.rgb, taken.mesh_index, place)


def hidden(scene: MarkedScene, camera: Camera) -> Mask:
    """Mask of the faces that are left out: walls in front of the camera, ceilings, horizontal faces of the room
    overhead, and, if the orientation of the faces is reliable, all faces seen from behind: a scan shows its walls from
    the room's side only."""
    cut = cut_faces(scene.mesh, scene.structure, camera.position, camera.target)
    normal, floor = scene.mesh.face_normals, framed(scene)[0][2]
    height, length = scene.mesh.triangles[:, :, 2], np.linalg.norm(normal, axis=1)
    overhead = (np.abs(normal[:, 2]) > LEVEL * length) & (height.min(axis=1) > floor + HEAD)
    plan = float(np.prod(np.ptp(scene.mesh.bounds[:, :2], axis=0)))
    room = scene.structure.copy()
    for mark in scene.marks:
        if 4.0 * float(np.prod(mark.box.half_extents[:2])) > WIDE * plan:
            room[mark.faces] = True
    cut |= overhead & room
    low = height.max(axis=1) < floor + ON_THE_FLOOR
    up, down = (float(length[low & (sign * normal[:, 2] > LEVEL * length)].sum()) for sign in (1.0, -1.0))
    if up > ONE_SIDED * (up + down) > 0.0:
        center = scene.mesh.triangles.mean(axis=1)
        cut |= np.einsum("ij,ij->i", normal, camera.position - center) < 0.0
    return np.asarray(cut)


def framed(scene: MarkedScene) -> tuple[Array, Array]:
    """Lowest and highest corner of the pictured box [m], each of shape (3,): it contains almost all of the surface."""
    center, area = scene.mesh.triangles.mean(axis=1), scene.mesh.face_areas
    low, high = (np.array([share_of(center[:, axis], area, share) for axis in range(3)]) for share in (0.002, 0.998))
    return low, high


def share_of(values: Array, weight: Array, share: float) -> float:
    """The value below which a share of the weight lies; the extreme value if the weight is concentrated there."""
    order = np.argsort(values)
    total = np.cumsum(weight[order])
    return float(values[order[min(int(np.searchsorted(total, share * total[-1])), len(values) - 1)]])


def corner_camera(middle: Array, half: Array, corner: Sequence[float], size: int) -> Camera:
    """The nearest camera beyond a corner of a box that sees the whole box, with the box in the middle of the
    picture."""
    lift = np.radians(ELEVATION_DEG)
    flat = np.array(corner) / np.linalg.norm(corner)
    way = np.array([*(np.cos(lift) * flat), np.sin(lift)])
    points = middle + half * np.array([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)])
    target = middle
    camera = fitting(points, target, way, half, size)
    for _ in range(CENTERED):
        image = camera.project(points)
        off = 0.5 * (image[:, :2].min(axis=0) + image[:, :2].max(axis=0)) - 0.5 * np.array(
            [camera.width, camera.height]
        )
        depth = float(np.linalg.norm(camera.position - target))
        target = target + camera.world_from_camera[:, :2] @ (off * depth / camera.focal)
        camera = fitting(points, target, way, half, size)
    return camera


def fitting(points: Array, target: Array, way: Array, half: Array, size: int) -> Camera:
    """The nearest camera along a direction from a target that sees all points (n, 3)."""
    frame = np.array([size, round(VIEW_SHAPE * size)])
    unit = max(float(np.linalg.norm(half)), 1e-6)
    near, far = 0.5, 40.0
    for _ in range(HALVINGS):  # the points' extent in the picture falls with the distance
        distance = float(np.sqrt(near * far))
        image = looking_at(target + distance * unit * way, target, *frame.tolist()).project(points)
        fits = (image[:, 2] > 0).all() and (2.0 * RIM * np.abs(image[:, :2] - frame / 2) < frame).all()
        near, far = (near, distance) if fits else (distance, far)
    return looking_at(target + far * unit * way, target, *frame.tolist())


def candidates_picture(scene: Segmentation) -> NDArray[np.uint8]:
    """Plan and view side by side, the list below, shape (h, w, 3)."""
    pictures = marked(scene)
    shots = [Image.fromarray(plan_picture(pictures)), Image.fromarray(room_pictures(pictures, 1)[0])]
    return np.asarray(composed(shots, listed(scene)), dtype=np.uint8).copy()


def listed(scene: Segmentation) -> list[tuple[int, str, str]]:
    """Number, name and size of each numbered thing."""
    found = []
    for index, number in numbers_of(scene).items():
        one = scene.instances[index]
        size = " x ".join(f"{2.0 * half:.2f}" for half in one.box.half_extents)
        found.append((number, f"{one.label} {one.confidence:.0%}", f"{one.id}, {size} m"))
    return found


def composed(shots: Sequence[Image.Image], lines: Sequence[tuple[int, str, str]]) -> Image.Image:
    """Pictures in a row and a list in columns below; `lines`: number, name and size."""
    width = sum(shot.width for shot in shots) + GAP * (len(shots) + 1)
    columns = max(1, (width - GAP) // COLUMN)
    rows = -(-len(lines) // columns)
    top = max(shot.height for shot in shots) + 2 * GAP
    image = Image.new("RGB", (width, top + rows * ROW + GAP), BACKGROUND)
    left = GAP
    for shot in shots:
        image.paste(shot, (left, GAP))
        left += shot.width + GAP
    draw, font, small = ImageDraw.Draw(image), ImageFont.load_default(LETTERS), ImageFont.load_default(LETTERS - 4)
    for k, (number, name, about) in enumerate(lines):
        x, y = GAP + (k // rows) * COLUMN, top + (k % rows) * ROW
        breadth, height = badge_size(draw, str(number), font)
        box = (x, y, x + max(breadth, 34), y + height)
        draw.rounded_rectangle(box, 5, PAPER, tuple(int(c) for c in paint(number)), 2)
        draw.text((0.5 * (box[0] + box[2]), 0.5 * (box[1] + box[3])), str(number), INK, font, "mm")
        draw.text((x + 42, y + 0.5 * height), name, TEXT, font, "lm")
        after = draw.textlength(name, font)
        draw.text(
            (x + 50 + after, y + 0.5 * height), shortened(draw, about, small, COLUMN - 64 - after), FAINT, small, "lm"
        )
    return image


def shortened(
    draw: ImageDraw.ImageDraw, text: str, font: ImageFont.ImageFont | ImageFont.FreeTypeFont, width: float
) -> str:
    """A text cut to fit the width."""
    while text and draw.textlength(text, font) > width:
        text = text[:-2].rstrip(" .") + "." if len(text) > 2 else ""
    return text
