"""A small run of three methods on four samples, as a benchmark of several methods writes it, made without a drop.

Each sample is a ball on a bed by formula. One method lays it in its dent, one lets it float a little, one puts it into
the bed; their pictures differ in colour, so that a test sees which is which.
"""

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from functools import cache
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import trimesh
from PIL import Image, ImageDraw

from dcap.evaluation.judging.cameras import PlacedThing, box_corners, sample_cameras, sights_of
from dcap.evaluation.methods import joined_id
from dcap.evaluation.outcome_table import SampleOutcome
from dcap.evaluation.run_folder import sample_folder
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.pictures import PLACED, Sights
from dcap.scene.writers.glb import Node, glb_bytes
from flows.find_run import ASKED_VERSION

METHODS = ("dcap", "fireplace", "layoutgpt")
SAMPLES = {
    "bed-1": "put the ball at the center of the bed",
    "bed-2": "put the ball <b>near</b> the pillow & leave it",
    "sofa/3": "put the ball on the left seat of the sofa",
    "desk-4": "put the ball on the desk, 10 cm from its edge",
}
HEIGHTS = {"dcap": -0.02, "fireplace": 0.05, "layoutgpt": -0.09}
"""Of the ball's lowest point over the bed's top [m]."""
COLORS = {"dcap": (40, 130, 70), "fireplace": (60, 90, 190), "layoutgpt": (190, 90, 40)}
RADIUS, TOP = 0.1, 0.5
SIZE = (320, 240)


def method_folder(run: Path, method: str, sample: str) -> Path:
    """Where a method's files of a sample lie."""
    return sample_folder(run if method == "dcap" else run / "methods" / method, sample)


def ball_at(x: float, height: float) -> Mesh:
    """The ball over the bed."""
    mesh = trimesh.creation.icosphere(2, RADIUS)
    return Mesh.of(mesh.vertices + np.array([x, 0.0, TOP + RADIUS + height]), mesh.faces, (200, 60, 40))


@cache
def room() -> tuple[Mesh, Mesh]:
    """A bed and a floor."""
    bed = trimesh.creation.box((1.6, 2.0, TOP)).subdivide().subdivide()
    floor = trimesh.creation.box((6.0, 6.0, 0.05))
    return (
        Mesh.of(bed.vertices + np.array([0.0, 0.0, TOP / 2]), bed.faces, (215, 215, 230)),
        Mesh.of(floor.vertices - [0.0, 0.0, 0.025], floor.faces, (150, 110, 80)),
    )


def scene_glb(height: float, x: float = 0.0) -> bytes:
    """The room with the ball in it."""
    bed, floor = room()
    inside = Node("scene", children=(Node("bed", bed, "bed"), Node("floor", floor, "floor")))
    return glb_bytes([inside, Node("object", ball_at(x, height))])


@cache
def seen_at(height: float, x: float) -> Sights:
    """What can be seen of the ball."""
    bed, floor = room()
    scene = Mesh.concatenate([bed, floor])
    placed = PlacedThing.of(scene, np.arange(len(scene.faces)) >= len(bed.faces), ball_at(x, height))
    return sights_of(placed, box_corners(*bed.bounds), scene.bounds.mean(axis=0))


def draw(path: Path, words: str, color: tuple[int, int, int]) -> None:
    """A picture of one colour with a disc and words on it."""
    image = Image.new("RGB", SIZE, (232, 232, 228))
    pen = ImageDraw.Draw(image)
    pen.rectangle((20, 140, 300, 220), fill=(205, 205, 220))
    pen.ellipse((120, 70, 200, 150), fill=color)
    pen.text((10, 10), words, fill=(60, 60, 60))
    path.parent.mkdir(parents=True, exist_ok=True)
    image.save(path)


def many_methods_run(
    folder: Path,
    methods: tuple[str, ...] = METHODS,
    chooser: str = "",
    prompts: Mapping[str, str] = SAMPLES,
) -> Path:
    """Write the run; returns its folder. `chooser` is the model that answered for its placements, empty for none."""
    rows = []
    for method in methods:
        for number, (sample, prompt) in enumerate(prompts.items()):
            out = method_folder(folder, method, sample)
            out.mkdir(parents=True)
            height = HEIGHTS[method]
            tree = {"method": method, "verdict": "at_rest" if method == "dcap" else "as_posed", "reason": None}
            (out / "placement.json").write_text(json.dumps(tree))
            (out / "scene.glb").write_bytes(scene_glb(height, 0.1 * number))
            (out / "object.glb").write_bytes(glb_bytes([Node("object", ball_at(0.0, height))]))
            for name in PLACED:
                draw(out / "views" / f"{name}.png", f"{number + 1} {name}", COLORS[method])
            for name in ("settled", "closeup"):
                draw(out / f"{name}.png", name, COLORS[method])
            draw(out / "views" / "clean.png", f"room {number + 1}", (232, 232, 228))
            draw(out / "views" / "asset.png", f"asset {number + 1}", (200, 60, 40))
            cameras = sample_cameras([seen_at(HEIGHTS[one], 0.1 * number) for one in methods])
            contact = list(seen_at(height, 0.1 * number).contact[cameras.direction])
            states = {joined_id(one, sample): "" for one in methods}
            seen: dict[str, object] = {"states": states, **asdict(cameras), "contact": contact}
            (out / "views" / "cameras.json").write_text(json.dumps(seen))
            rows.append(row(method, sample, prompt))
    write_rows(folder, rows)
    samples = [
        {
            "id": one,
            "prompt": prompt,
            "scene": "room",
            "object": "ball.glb",
            "seed": 0,
            "scene_options": {},
            "object_options": {},
        }
        for one, prompt in prompts.items()
    ]
    asked: dict[str, object] = {"version": ASKED_VERSION, "methods": list(methods), "samples": samples}
    if chooser:
        asked["config"] = {"intent": {"language": {"client": "anthropic", "model": chooser}}}
    (folder / "run.json").write_text(json.dumps(asked))
    return folder


def write_rows(folder: Path, rows: Sequence[SampleOutcome]) -> None:
    """Write results.parquet."""
    pq.write_table(pa.Table.from_pylist([asdict(one) for one in rows]), folder / "results.parquet")


def change_row(run: Path, method: str, sample: str, **values: object) -> None:
    """Write results.parquet with other values in one row."""
    rows = pq.read_table(run / "results.parquet").to_pylist()
    next(one for one in rows if (one["method"], one["sample"]) == (method, sample)).update(values)
    pq.write_table(pa.Table.from_pylist(rows), run / "results.parquet")


def row(method: str, sample: str, prompt: str) -> SampleOutcome:
    """A row of results.parquet with what a stage would have measured; better, the less the ball floats or is inside."""
    height, settled = HEIGHTS[method], method == "dcap"
    return SampleOutcome(
        sample=sample, scene="bedroom", object="ball.glb", prompt=prompt, verdict="at_rest" if settled else "as_posed",
        reason="", message="", base="bed", base_id="1", part="", region="", region_missed=False, mass=1.0, scale=1.0,
        visible_fraction=0.8, seconds=1.0, error="", expected="at rest on bed", feasible_intended=True,
        as_expected=True, method=method, support_hit=True, region_distance_m=0.01 if settled else 0.1,
        penetration_m=0.0 if settled else max(0.0, -height), gap_m=max(0.0, height), contact_area_m2=0.01,
        com_margin_m=0.1, com_supported=True, indentation_m=max(0.0, -height), indentation_error_m=abs(height + 0.02),
        force_residual=0.001, drift_m=0.0 if settled else 0.02, drift_s=1.0,
    )  # fmt: skip
