"""Makes the pictures of the documentation: `make docs-pictures`, or `python docs/make_pictures.py [NAME ...]` for some.

In: two placements in embedded rooms, which are made where they are not in the cache. Out: small files in docs/images,
each from values that the stages returned. The renderer is DCAP's own; curves are drawn by matplotlib.
"""

import io
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

import matplotlib.pyplot as plt
import numpy as np
import trimesh
from matplotlib.figure import Figure
from numpy.typing import NDArray
from PIL import Image, ImageDraw, ImageFont

import dcap
from dcap.geometry.camera import Camera, looking_at
from dcap.geometry.raycast import Raycaster
from dcap.geometry.rendering.picture import picture
from dcap.scene.settings import data_root, runs_root
from dcap.scene.types.choices import Intent
from dcap.scene.types.mesh import Mesh, PaintedMesh
from dcap.scene.types.particles import SoftSimulationBody
from dcap.scene.types.segmentation import Segmentation
from dcap.synthetic.dataset import make_dataset
from flows.extra_output import automatic_camera
from flows.placement_json import Values
from flows.run_files import finished_placement
from tasks.anchor.request import base_from_above, neighbours
from tasks.artifact import Store
from tasks.render.config import RenderConfig
from tasks.render.maps import conditioning_maps, placed
from tasks.render.settled_meshes import settled_item, settled_scene, shown
from tasks.render.views import contact_middle, front
from tasks.requests.marks import marked, plan_picture, room_pictures
from tasks.requests.surroundings import part_frame, wished_place
from tasks.requests.views import instance_of
from tasks.rotation.pose_pictures import three_flips

plt.switch_backend("Agg")

Rgb = NDArray[np.uint8]

IMAGES = Path(__file__).resolve().parent / "images"
LARGEST = 150_000
"""No picture is larger [bytes]: the clone stays small."""
GAP = 12
"""White between pictures side by side [pixels]."""
RADIUS, MASS = 0.10, 12.0
"""Of the heavy ball [m], [kg]."""
COLORS = (np.array(plt.get_cmap("tab20").colors) * 255).astype(np.uint8)  # type: ignore[attr-defined]


# --- the placements -----------------------------------------------------------------------------------------------


def placement_of(name: str, room: str, thing: Path, prompt: str, **options: object) -> Values:
    """The values of a placement's stages; it is made, or found in the cache."""
    out = runs_root() / "docs" / name
    dcap.place(data_root() / "rooms" / room, thing, prompt, out=out, **options)
    return finished_placement(str(out), None).values


@cache
def toy() -> Values:
    """The ball of the quick start."""
    make_dataset(data_root(), 0, rooms=["bedroom_01"])
    ball = data_root() / "objects" / "ball.glb"
    return placement_of("toy", "bedroom_01", ball, "put the ball at the center of the bed")


@cache
def heavy() -> Values:
    """A heavy dark ball on a bed whose blanket is checked, so that one sees how it bends."""
    make_dataset(data_root(), 0, rooms=["bedroom_02"])
    path = runs_root() / "docs" / "heavy_ball.ply"
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(heavy_ball())
    frame = {"object_label": "bowling ball", "object_unit": "m", "object_up": "z"}
    return placement_of("heavy", "bedroom_02", path, "put the ball at the center of the bed", mass=MASS, **frame)


def heavy_ball() -> bytes:
    """A marbled ball with three finger holes painted on, as PLY."""
    ball = trimesh.creation.icosphere(5, RADIUS)
    way = np.asarray(ball.vertices) / RADIUS
    swirl = np.sin(5.0 * way[:, 0] + 3.0 * np.sin(3.0 * way[:, 1]) + 4.0 * way[:, 2])
    color = np.clip(np.array([44.0, 52.0, 84.0]) + 20.0 * swirl[:, None], 0, 255).astype(np.uint8)
    for x, y in ((0.18, 0.0), (-0.08, 0.16), (-0.08, -0.16)):
        middle = np.array([x, y, np.sqrt(1.0 - x * x - y * y)])
        color[np.linalg.norm(way - middle, axis=1) < 0.085] = (10, 10, 14)
    told = trimesh.Trimesh(ball.vertices, ball.faces, vertex_colors=color, process=False).export(file_type="ply")
    assert isinstance(told, bytes)
    return told


# --- views ------------------------------------------------------------------------------------------------------------


def view(values: Values, size: tuple[int, int], angles: tuple[float, float], distance: float, fov: float) -> Camera:
    """A camera that looks at the contact, from an azimuth off the base's front and an elevation [degrees]."""
    assert values.settled
    assert values.anchor
    assert values.scene
    target, toward = contact_middle(values.settled, values.anchor), front(values.scene, values.anchor)
    turn, lift = np.radians(angles)
    side = np.array([-toward[1], toward[0], 0.0])
    flat = np.cos(turn) * toward + np.sin(turn) * side
    way = np.cos(lift) * flat + np.sin(lift) * np.array([0.0, 0.0, 1.0])
    target = target + np.array([0.0, 0.0, 0.03])
    return looking_at(target + distance * way, target, *size, fov_deg=fov)


def at_rest(values: Values) -> tuple[Segmentation, Mesh]:
    """The scene with its dents, and the object, as they settled."""
    assert values.scene
    assert values.item
    assert values.settled
    assert values.anchor
    after = settled_scene(values.scene, values.settled, values.anchor.base_id).scene
    return after, settled_item(values.item, values.anchor, values.settled.bodies[0])


def softness() -> Rgb:
    """The bed before, the heavy ball sunk into it, and the dent that is under the ball."""
    values = heavy()
    assert values.scene
    after, thing = at_rest(values)
    camera = view(values, (480, 400), (24.0, 19.0), 0.78, 34.0)
    with_ball: list[Mesh | PaintedMesh] = [*shown(after, camera), thing]
    views = (shown(values.scene, camera), with_ball, shown(after, camera))
    pictures = [picture(meshes, camera).rgb for meshes in views]
    words = ("before", f"after: {MASS:.0f} kg", "the dent, without the ball")
    return beside([captioned(one, word, 28) for one, word in zip(pictures, words, strict=True)])


def before_after() -> Rgb:
    """The three pictures that a placement writes."""
    renders = toy().renders
    assert renders
    return beside([small(one, 400) for one in (renders.clean, renders.settled, renders.closeup)])


def mesh_stage() -> Rgb:
    """The room as read, and its triangles around the bed."""
    values = toy()
    assert values.scene
    camera = room_camera(values)
    lit = picture(shown(values.scene, camera), camera).rgb
    faces = values.scene.mesh
    hue = np.random.default_rng(0).integers(110, 245, (len(faces.faces), 1)).astype(np.uint8)
    apart = painted(values.scene, np.repeat(hue, 3, axis=1))
    return beside([lit, picture(shown(apart, camera), camera, shadows=False).rgb])


def segment_stage() -> Rgb:
    """Every instance, and every part, in a colour of its own."""
    values = toy()
    assert values.scene
    scene, camera = values.scene, room_camera(values)
    rows = []
    for index in (scene.face_instance, 7 * scene.face_instance + 3 * scene.face_part):
        color = COLORS[index % len(COLORS)]
        rows.append(picture(shown(painted(scene, color), camera), camera).rgb)
    return beside(rows)


def intent_stage() -> Rgb:
    """The things among which the sentence chooses, numbered: the room and its plan as a model is shown them."""
    scene = toy().scene
    assert scene
    marks = marked(scene)
    room, plan = room_pictures(marks, 1)[0], plan_picture(marks)
    height = 420
    return beside([small(one, round(one.shape[1] * height / one.shape[0])) for one in (room, plan)])


def rotation_stage() -> Rgb:
    """The three pictures of which the rotation is chosen, of a thing that has a top and a front."""
    make_dataset(data_root(), 0, rooms=["bedroom_02"])
    laptop = data_root() / "objects" / "laptop.glb"
    prompt = "set the laptop on the desk with its screen facing the chair"
    out = runs_root() / "docs" / "laptop"
    dcap.place(data_root() / "rooms" / "bedroom_02", laptop, prompt, out=out)
    refs, store = finished_placement(str(out), None).finished.placement, Store.default()
    assert refs.scene
    assert refs.item
    assert refs.intent
    scene, item, intent = store.load(refs.scene), store.load(refs.item), store.load(refs.intent)
    assert isinstance(scene, Segmentation)
    assert isinstance(item, Segmentation)
    assert isinstance(intent, Intent)
    base = instance_of(scene, intent.base_id)
    mesh = item.mesh.transformed(np.diag([intent.scale] * 3 + [1.0]))
    place = wished_place(scene, base, intent, 0.5 * float(np.ptp(mesh.bounds[:, :2], axis=0).max()))
    return beside([small(one, 360) for one in three_flips(scene, base, mesh, place, 512)])


def anchor_stage() -> Rgb:
    """The base from above as a client sees it, and the object where its drop begins."""
    values = toy()
    assert values.scene
    assert values.anchor
    assert values.item
    scene, anchor = values.scene, values.anchor
    base = instance_of(scene, anchor.base_id)
    above = base_from_above(scene, base, part_frame(scene, base, base.box), neighbours(scene, base))
    camera = view(values, (420, 420), (20.0, 12.0), 0.9, 34.0)
    start = values.item.mesh.transformed(anchor.world_from_object)
    return beside([small(above, 420), picture([*shown(scene, camera), start], camera).rgb])


def materials_stage() -> Rgb:
    """The bed by the stiffness of its parts: red soft, blue rigid."""
    values = toy()
    assert values.scene
    assert values.materials
    scene = values.scene
    color = np.full((len(scene.mesh.faces), 3), 225, dtype=np.uint8)
    for row in values.materials.rows:
        if row.body == "object":
            continue
        mine = (scene.face_instance == scene.index_of(row.body)) & (scene.face_part == row.part_index)
        share = np.clip((np.log10(row.material.youngs_modulus) - 4.0) / 6.0, 0.0, 1.0)
        color[mine] = (np.array(plt.get_cmap("coolwarm_r")(share))[:3] * 255).astype(np.uint8)
    camera = room_camera(values, size=(640, 460))
    return picture(shown(painted(scene, color), camera), camera).rgb


def maps_stage() -> Rgb:
    """Some of the conditioning maps of the same view."""
    values = toy()
    assert values.scene
    assert values.item
    assert values.anchor
    assert values.settled
    config = RenderConfig(size=300)
    camera = automatic_camera(values, config)
    what = placed(values.scene, values.item, values.anchor, values.materials, values.settled)
    found = conditioning_maps(what, camera, config, cutaway=True)
    near = np.isfinite(found.depth)
    depth = np.where(near, found.depth, np.nan)
    span = np.nanmin(depth), np.nanmax(depth)
    grey = np.nan_to_num((depth - span[0]) / (span[1] - span[0]))
    instance = COLORS[found.instance.astype(int) % len(COLORS)]
    pictures = {
        "rgb": found.rgb,
        "depth": (plt.get_cmap("viridis")(1.0 - grey)[..., :3] * 255).astype(np.uint8),
        "normals": ((found.normal_world + 1.0) * 127.5).astype(np.uint8),
        "object mask": np.repeat(found.object_mask[..., None], 3, axis=2),
        "instances": instance,
    }
    return beside([captioned(small(one, 240), name) for name, one in pictures.items()])


def room_camera(values: Values, size: tuple[int, int] = (560, 420)) -> Camera:
    """The bed and what is around it."""
    return view(values, size, (28.0, 32.0), 3.4, 50.0)


def painted(scene: Segmentation, color: Rgb) -> Segmentation:
    """The scene with a flat colour on each face (m, 3)."""
    corners = scene.mesh.triangles.reshape(-1, 3)
    faces = np.arange(len(corners), dtype=np.int32).reshape(-1, 3)
    return replace(scene, mesh=Mesh(corners, faces, np.repeat(color, 3, axis=0)))


# --- curves -----------------------------------------------------------------------------------------------------------


def particles_stage() -> Rgb:
    """The material points of the bed under the heavy ball, by stiffness, and the ball above them, cut in the middle."""
    values = heavy()
    assert values.particles
    figure, axes = plt.subplots(figsize=(7.2, 3.3), dpi=110)
    ball = values.particles.bodies[0].surface
    middle = ball.vertices.mean(axis=0)
    for body in values.particles.bodies:
        if isinstance(body, SoftSimulationBody):
            points = body.points
            cut = np.abs(points.position[:, 1] - middle[1]) < 0.012
            where = points.position[cut] - middle
            shade = axes.scatter(
                100 * where[:, 0], 100 * where[:, 2], s=3, c=points.youngs_modulus[cut] / 1e3, cmap="viridis"
            )
            figure.colorbar(shade, label="Young's modulus [kPa]")
    turn = np.linspace(0.0, 2.0 * np.pi, 200)
    axes.fill(100 * RADIUS * np.cos(turn), 100 * RADIUS * np.sin(turn), color="#2c3454")
    axes.set(xlabel="x [cm]", ylabel="z [cm]", aspect="equal", title="a cut through the start of the drop")
    return drawn(figure)


def signals_stage() -> Rgb:
    """Speeds and residuals of the drop, and what rest asks for."""
    settled = heavy().settled
    assert settled
    assert settled.certificate
    told, rows = settled.history, settled.certificate.signals
    figure, (left, right) = plt.subplots(1, 2, figsize=(9.2, 3.2), dpi=110)
    left.semilogy(told.time, told.linear_speed, label="ball")
    moving = np.where(told.particle_speed > 0.0, told.particle_speed, np.nan)
    left.semilogy(told.time, moving, label="fastest particle")
    left.axhline(rows.linear_speed.threshold, color="grey", linestyle=":", label="threshold of rest")
    left.set(xlabel="time [s]", ylabel="speed [m/s]")
    right.semilogy(told.time, told.force_residual, label="force")
    right.semilogy(told.time, np.where(told.torque_residual > 0.0, told.torque_residual, np.nan), label="torque")
    right.axhline(rows.force_residual.threshold, color="grey", linestyle=":", label="threshold of rest")
    right.set(xlabel="time [s]", ylabel="unbalanced over weight [-]")
    for axes in (left, right):
        axes.legend(fontsize=8)
    return drawn(figure)


def profile_stage() -> Rgb:
    """A cut through ball and bed at rest, and the bed's surface before."""
    values = heavy()
    assert values.scene
    assert values.settled
    after, thing = at_rest(values)
    middle = 0.5 * (thing.bounds[0] + thing.bounds[1])
    figure, axes = plt.subplots(figsize=(7.2, 2.4), dpi=110)
    across = np.linspace(-0.3, 0.3, 601)
    above = np.stack([middle[0] + across, np.full(601, middle[1]), np.full(601, middle[2] + 1.0)], axis=1)
    down = np.broadcast_to([0.0, 0.0, -1.0], above.shape)
    for scene, style, word in ((values.scene, "--", "before"), (after, "-", "at rest")):
        height = Raycaster(scene.mesh.submesh(loose_faces(scene))).cast(above, down).position[:, 2]
        axes.plot(100 * across, 100 * (height - middle[2] + RADIUS), style, color="#b6503c", label=f"bed, {word}")
    turn = np.linspace(0.0, 2.0 * np.pi, 200)
    axes.fill(100 * RADIUS * np.cos(turn), 100 * RADIUS * (1.0 + np.sin(turn)), color="#2c3454", label="ball at rest")
    axes.set(xlabel="across the bed [cm]", ylabel="height [cm]", aspect="equal", ylim=(-1, 12))
    axes.legend(fontsize=8, loc="upper right")
    return drawn(figure)


def loose_faces(scene: Segmentation) -> NDArray[np.int64]:
    """Faces of what is no part of the building, shape (k,)."""
    flag = np.array([one.structure for one in scene.instances] + [True])
    return np.flatnonzero(~flag[scene.face_instance])


# --- files ------------------------------------------------------------------------------------------------------------


def drawn(figure: Figure) -> Rgb:
    """The pixels of a figure."""
    figure.tight_layout()
    file = io.BytesIO()
    figure.savefig(file, format="png")
    plt.close(figure)
    return np.asarray(Image.open(file).convert("RGB"))


def beside(pictures: Sequence[Rgb]) -> Rgb:
    """Pictures of one height in a row."""
    height = max(len(one) for one in pictures)
    gap = np.full((height, GAP, 3), 255, dtype=np.uint8)
    cells = []
    for one in pictures:
        cells += [gap, np.pad(one, ((0, height - len(one)), (0, 0), (0, 0)), constant_values=255)]
    return np.concatenate(cells[1:], axis=1)


def small(rgb: Rgb, width: int) -> Rgb:
    """A picture of another width."""
    return np.asarray(
        Image.fromarray(rgb).resize((width, round(width * len(rgb) / rgb.shape[1])), Image.Resampling.LANCZOS)
    )


def captioned(rgb: Rgb, words: str, height: int = 18) -> Rgb:
    """A picture with a word in its corner."""
    image = Image.fromarray(rgb)
    font = ImageFont.load_default(size=height)
    ImageDraw.Draw(image).text((10, 8), words, "white", font, stroke_width=2, stroke_fill=(40, 40, 40))
    return np.asarray(image)


def save(name: str, rgb: Rgb) -> None:
    """Write a picture as JPEG, curves as PNG; one that is too large is an error."""
    path = IMAGES / name
    IMAGES.mkdir(exist_ok=True)
    if path.suffix == ".png":
        Image.fromarray(rgb).quantize(128).save(path, optimize=True)
    else:
        Image.fromarray(rgb).save(path, quality=86, optimize=True)
    size = path.stat().st_size
    print(f"{path.name:24} {rgb.shape[1]} x {rgb.shape[0]}, {size / 1000:.0f} kB")
    if size > LARGEST:
        raise SystemExit(f"{path} has {size} bytes, more than {LARGEST}")


PICTURES: dict[str, Callable[[], Rgb]] = {
    "softness.jpg": softness,
    "before_after.jpg": before_after,
    "mesh.jpg": mesh_stage,
    "segment.jpg": segment_stage,
    "intent.jpg": intent_stage,
    "rotation.jpg": rotation_stage,
    "anchor.jpg": anchor_stage,
    "materials.jpg": materials_stage,
    "particles.png": particles_stage,
    "drop_signals.png": signals_stage,
    "dent_profile.png": profile_stage,
    "maps.jpg": maps_stage,
}


def main(names: Sequence[str]) -> None:
    """Make the named pictures, all where none is named."""
    for name in names or PICTURES:
        if name not in PICTURES:
            raise SystemExit(f"{name!r} is not a picture; there are {', '.join(PICTURES)}")
        save(name, PICTURES[name]())


if __name__ == "__main__":
    main(sys.argv[1:])
