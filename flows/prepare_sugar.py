"""Writes what SuGaR takes from a scene of splats: posed pictures, cameras, Gaussians, and how to run it.

Everything is written beside the folder and moved there in one step; what else lies in an earlier result is kept.
"""

import os
import shlex
import shutil
import sys
import tempfile
from collections.abc import Callable
from pathlib import Path

from rich.console import Console

from flows.output import readable_json
from geometry.camera_path import PathConfig, camera_path
from scene.errors import GeometryError, InputError
from scene.readers.splat_scene import SplatScene, read_splat_scene
from scene.sample import SourceOptions
from scene.settings import runs_root
from scene.sugar_write import run_script, train_command, write_picture, write_sugar_model
from tasks.sugar_views import colmap_model, names, pictures

RECORD = "prepared.json"
"""By this file a folder is known to be ours."""
OWNED = ("images", "sparse", "checkpoint", "run_sugar.sh", RECORD)

Progress = Callable[[str], None]


def prepare_sugar(
    scene: Path, out: Path | None, options: SourceOptions, config: PathConfig, *, threads: int, quiet: bool
) -> tuple[Path, dict[str, object]]:
    """Prepare a scene; the folder and what its prepared.json holds. Progress goes to standard error unless `quiet`."""
    scene = scene.absolute()
    folder = (out or runs_root() / "sugar" / scene.stem).absolute()
    check_folder(folder, scene)
    with Console(file=sys.stderr, quiet=quiet, highlight=False).status("reading") as status:
        source = read_splat_scene(scene, options)
        try:
            folder.parent.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryDirectory(dir=folder.parent, prefix=f".{folder.name}.") as beside:
                draft = Path(beside) / "new"
                draft.mkdir()
                record = write_all(draft, folder, scene, source, config, threads, status.update)
                publish(draft, folder, Path(beside) / "old")
        except OSError as error:
            raise InputError(f"--out {folder}: cannot be written: {error.strerror or error}") from None
    return folder, record


def check_folder(folder: Path, scene: Path) -> None:
    """Refuse a folder that holds something else, or that would become part of the scene."""
    if scene.is_dir() and folder.resolve().is_relative_to(scene.resolve()):
        raise InputError(f"--out {folder} lies in the scene {scene}, whose files are all input; name another place")
    if folder.exists() and not (folder / RECORD).is_file() and any(folder.iterdir()):
        raise InputError(f"--out {folder}: not empty and not made by prepare-sugar (no {RECORD}); name another folder")


def write_all(
    draft: Path, folder: Path, scene: Path, source: SplatScene, config: PathConfig, threads: int, progress: Progress
) -> dict[str, object]:
    """Everything for `folder`, written into `draft`."""
    progress("placing cameras")
    path = camera_path(source.splats, config, boxes=source.boxes, rooms=source.rooms, occupancy=source.occupancy)
    if not path.cameras:
        raise GeometryError(f"{source.path}: no place for a camera: none sees anything but what is right before it")
    count = len(path.cameras)
    drawn = zip(names(count), pictures(source.splats, path.cameras, threads), strict=True)
    for k, (name, picture) in enumerate(drawn):
        write_picture(draft, name, picture)
        progress(f"view {k + 1} of {count}")
    model = colmap_model(source.splats, path.cameras, config.seed)
    write_sugar_model(draft, model, source.splats)
    target = scene if scene.is_dir() else folder / "mesh"
    script = draft / "run_sugar.sh"
    script.write_text(run_script(folder, target), encoding="utf-8")
    script.chmod(0o755)
    record: dict[str, object] = {
        "scene": str(scene),
        "splats": len(source.splats),
        "views": count,
        "points": len(model.points),
        "config": config.model_dump(),
        "world_from_file": source.world_from_file.tolist(),
        "command": train_command(folder),
        "then": place_command(target, source),
        "notes": [*source.notes, *path.notes],
    }
    (draft / RECORD).write_bytes(readable_json(record))
    return record


def place_command(target: Path, source: SplatScene) -> str:
    """How to place something in the scene once SuGaR's mesh is there."""
    # the mesh is in metres and z up; its own format does not say so, InteriorGS' annotations do
    frame = "" if source.annotated else " --up z --unit m"
    return f'dcap place {shlex.quote(str(target))} OBJECT "PROMPT"{frame}'


def publish(draft: Path, folder: Path, aside: Path) -> None:
    """Put a finished draft in the folder's place, with what else lay there."""
    if folder.is_dir():
        for entry in folder.iterdir():
            if entry.name not in OWNED:
                shutil.move(entry, draft / entry.name)
        os.replace(folder, aside)
    os.replace(draft, folder)


def summary(folder: Path, record: dict[str, object]) -> str:
    """What a person needs to know next."""
    notes = record["notes"]
    assert isinstance(notes, list)
    script = shlex.quote(str(folder / "run_sugar.sh"))
    return "\n".join(
        [
            *(f"note: {note}" for note in notes),
            f"{record['views']} views of {record['splats']} splats: {folder}",
            "in the folder of SuGaR, on a machine with a graphics card:",
            f"  {record['command']}",
            f"or, which also copies its meshes to where they are found: sh {script} PATH_OF_SUGAR",
            f"then: {record['then']}",
        ]
    )
