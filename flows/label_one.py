"""Labels the things of a scene: runs only the stages mesh and segment, writes labels.json and a page of pictures."""

import os
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image

from dcap.evaluation.pages import Row, labels_page
from dcap.geometry.segmentation.faces import main_level
from dcap.language.protocol.client import ClientName
from dcap.language.protocol.session import Session
from dcap.scene.settings import runs_root
from dcap.scene.types.sample import Sample
from dcap.scene.types.scan import Scan
from dcap.scene.types.segmentation import Instance, Segmentation
from dcap.scene.writers.labels import FoundThing, labels_text, labels_tree
from dcap.scene.written_files import JsonObject, draft_folder, object_to_json
from flows.configure import configured, language_options
from flows.display import console_on
from flows.options import PlaceOptions
from flows.place import PlaceConfig, SceneRefs, scene_of
from flows.place_one import sample_of, stage_lines
from flows.sample_run import sample_context
from tasks.artifact import Store
from tasks.requests.badges import paint
from tasks.requests.marks import MarkedScene, marked, numbers_of, plan_picture, room_pictures, thumbnail
from tasks.run_context import RunContext

LABELS, PAGE, PLAN = "labels.json", "labels.html", "plan.png"
LEAST_GUESS, MOST_GUESSES = 0.05, 3
"""Alternative labels of a thing on the page: least probability, and largest number [-]."""
VIEWS = 2
"""Views of the room on the page [-]."""


def label_scene(scene: str, out: Path | None, options: PlaceOptions, *, quiet: bool) -> tuple[Path, JsonObject]:
    """Write the things of a scene into a folder. Returns the folder and the content of labels.json."""
    folder = out or runs_root() / "labels" / Path(scene.rstrip("/")).stem
    asking = language_options(options)
    sample = sample_of(scene, "things", "", options)
    refs = found_scene(sample, configured(options, language=asking.config()), asking.session(folder), quiet=quiet)
    scan, found = Store.default().load(refs.scan), Store.default().load(refs.scene)
    assert isinstance(scan, Scan)
    assert isinstance(found, Segmentation)
    things = found_things(found)
    tree = labels_tree(scan, found, things, scene)
    pictures = marked(found)
    plan = plan_picture(pictures, file_from_world=np.asarray(np.linalg.inv(scan.world_from_file), dtype=np.float64))
    offline = asking.config().client is ClientName.OFFLINE
    page = page_of(scene, folder, found, things, pictures, plan, offline=offline)
    write_all(folder, {LABELS: labels_text(tree).encode(), PAGE: page.encode()}, plan)
    return folder, object_to_json(tree)


def found_scene(sample: Sample, config: PlaceConfig, session: Session, *, quiet: bool) -> SceneRefs:
    """Run the two stages, or find their results in the cache."""
    console = console_on(sys.stderr, quiet=quiet)
    with console.status("reading") as status:
        context = RunContext(on_event=stage_lines(console, status), session=session)
        with sample_context(sample, context):
            return scene_of(sample, config)


def found_things(scene: Segmentation) -> list[FoundThing]:
    """The instances with their numbers, sizes and heights."""
    numbers = numbers_of(scene)
    floors = [main_level(scene.mesh, np.flatnonzero(scene.face_instance == i))
              for i, one in enumerate(scene.instances) if one.structure and one.label == "floor"]  # fmt: skip
    ground = next((level for level in floors if not np.isnan(level)), float(scene.mesh.bounds[0, 2]))
    found = []
    for index, one in enumerate(scene.instances):
        level = main_level(scene.mesh, np.flatnonzero(scene.face_instance == index))
        x, y, z = (float(2.0 * half) for half in one.box.half_extents)
        found.append(
            FoundThing(
                number=numbers.get(index, 0),
                index=index,
                id=one.id,
                label=one.label,
                confidence=one.confidence,
                structure=one.structure,
                size_m=(x, y, z),
                surface_m=None if np.isnan(level) else round(level - ground, 4) + 0.0,
            )
        )
    return found


def others_of(one: Instance) -> str:
    """Alternative labels of a thing, the likeliest first."""
    others = [(label, share) for label, share in one.guesses if label != one.label and share >= LEAST_GUESS]
    return ", ".join(f"{label} {share:.0%}" for label, share in others[:MOST_GUESSES])


def page_of(
    scene: str,
    folder: Path,
    found: Segmentation,
    things: Sequence[FoundThing],
    pictures: MarkedScene,
    plan: NDArray[np.uint8],
    *,
    offline: bool,
) -> str:
    """The page with all pictures."""
    by_number = {thing.number: thing for thing in things if thing.number}
    rows = [
        Row(
            thing=by_number[mark.number],
            picture=thumbnail(pictures, mark),
            color="rgb({:.0f}, {:.0f}, {:.0f})".format(*paint(mark.number)),
            parts=", ".join(part.name for part in found.instances[by_number[mark.number].index].parts),
            others=others_of(found.instances[by_number[mark.number].index]),
        )
        for mark in pictures.marks
    ]
    command = f'dcap place {scene} OBJECT "put it on the table" --labels {folder / LABELS}'
    return labels_page(Path(scene).name, plan, room_pictures(pictures, VIEWS), rows, command, offline=offline)


def write_all(folder: Path, files: dict[str, bytes], plan: NDArray[np.uint8]) -> None:
    """Write the files as drafts and move them into the folder; the plan is also a picture of its own."""
    with draft_folder(folder) as draft:
        for file, data in files.items():
            (draft / file).write_bytes(data)
        Image.fromarray(plan).save(draft / PLAN)
        for file in (*files, PLAN):
            os.replace(draft / file, folder / file)
