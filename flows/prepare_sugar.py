"""Writes the input of SuGaR for a scene of splats, and lets SuGaR make its mesh.

Everything is written to a draft next to the folder and moved there in one step; foreign files in an earlier result are
kept.

Meshes by SuGaR for scenes that only have Gaussian splats, if SuGaR's folder is named.

In: scenes. Out: the same scenes, each with a mesh; SuGaR's are where the script of `dcap dataset prepare-sugar` copies
them. A scene that has a mesh already is skipped, so an interrupted run resumes with the next scene.
"""

import os
import shlex
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rich.console import Console

from dcap.geometry.splatting.camera_path import PathConfig, camera_path
from dcap.scene.errors import GeometryError, InputError
from dcap.scene.readers.files import read_json
from dcap.scene.readers.scenes.interiorgs import is_interiorgs
from dcap.scene.readers.scenes.scannet import is_scannet
from dcap.scene.readers.scenes.sugar import find_mesh, has_only_splats
from dcap.scene.readers.source import SplatScene, read_splat_scene
from dcap.scene.settings import runs_root
from dcap.scene.types.sample import Sample, SourceOptions
from dcap.scene.writers.sugar import run_script, train_command, write_picture, write_sugar_model
from dcap.scene.written_files import object_to_json
from flows.output import readable_json
from flows.sample_files import slug
from tasks.artifact import Store
from tasks.mesh.sugar_views import colmap_model, names, pictures

RECORD = "prepared.json"
"""File that marks a folder as ours."""
OWNED = ("images", "sparse", "checkpoint", "run_sugar.sh", RECORD)

Progress = Callable[[str], None]
LOG = "sugar.log"
"""Log of SuGaR, next to its input."""
VIEWS = PathConfig()
"""Pictures of each scene for SuGaR."""
GIVEN, SUGAR, OWN = "given", "SuGaR", "reconstructed from the splats"


@dataclass(frozen=True, eq=False, slots=True)
class PreparedScene:
    """A prepared scene of splats, and how to use it; prepared.json has these keys in this order."""

    scene: str
    """Path of the scene."""
    splats: int
    """Number of Gaussians."""
    views: int
    """Number of pictures."""
    points: int
    """Number of points of the COLMAP model."""
    config: PathConfig
    world_from_file: NDArray[np.float64]
    """From the splats' file to the world [m], shape (4, 4)."""
    command: str
    """The line that makes meshes, to be run in SuGaR's own folder."""
    then: str
    """How to place something in the scene afterwards."""
    notes: tuple[str, ...]
    """Assumptions and failures, one sentence each."""


def prepare_sugar(
    scene: Path, out: Path | None, options: SourceOptions, config: PathConfig, *, threads: int, quiet: bool
) -> tuple[Path, PreparedScene]:
    """Prepare a scene. Returns the folder and the content of prepared.json. Progress goes to standard error unless
    `quiet`."""
    scene = scene.absolute()
    name = scene.name if scene.is_dir() else scene.stem
    folder = (out or runs_root() / "sugar" / name).absolute()
    folder = folder.resolve() if folder.is_symlink() else folder  # replace the link's target, not the link
    check_folder(folder, scene)
    with Console(file=sys.stderr, quiet=quiet, highlight=False).status("reading") as status:
        source = read_splat_scene(scene, options)
        try:
            folder.parent.mkdir(parents=True, exist_ok=True)
            with tempfile.TemporaryDirectory(dir=folder.parent, prefix=f".{folder.name}.") as temporary:
                draft = Path(temporary) / "new"
                draft.mkdir()
                record = write_all(draft, folder, scene, source, config, threads, status.update)
                publish(draft, folder)
        except OSError as error:
            raise InputError(f"--out {folder}: cannot be written: {error.strerror or error}") from None
    return folder, record


def check_folder(folder: Path, scene: Path) -> None:
    """Refuse a folder that holds something else, or that would become part of the scene."""
    if scene.is_dir() and folder.resolve().is_relative_to(scene.resolve()):
        raise InputError(f"--out {folder} lies in the scene {scene}, whose files are all input; choose another one")
    if folder.exists() and not (folder / RECORD).is_file() and any(folder.iterdir()):
        raise InputError(f"--out {folder}: not empty and not made by prepare-sugar (no {RECORD}); choose another one")
    earlier = earlier_scene(folder)
    if earlier is not None and earlier.resolve() != scene.resolve():
        raise InputError(f"{folder} was prepared from {earlier}, not from {scene}; choose another with --out")


def earlier_scene(folder: Path) -> Path | None:
    """The scene that an earlier result was made of; None where there is none."""
    if not (folder / RECORD).is_file():
        return None
    record = read_json(folder / RECORD)
    scene = record.get("scene") if isinstance(record, dict) else None
    if not isinstance(scene, str):
        raise InputError(f"{folder / RECORD}: names no scene, so prepare-sugar did not write it; choose another --out")
    return Path(scene)


def write_all(
    draft: Path, folder: Path, scene: Path, source: SplatScene, config: PathConfig, threads: int, progress: Progress
) -> PreparedScene:
    """Write everything for `folder` into `draft`."""
    progress("placing cameras")
    path = camera_path(source.splats, config, boxes=source.boxes, rooms=source.rooms, occupancy=source.occupancy)
    if not path.cameras:
        raise GeometryError(f"{source.path}: no place for a camera: something close blocks every view")
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
    record = PreparedScene(
        scene=str(scene),
        splats=len(source.splats),
        views=count,
        points=len(model.points),
        config=config,
        world_from_file=source.world_from_file,
        command=train_command(folder),
        then=place_command(target, source),
        notes=(*source.notes, *path.notes),
    )
    (draft / RECORD).write_bytes(readable_json(object_to_json(record)))
    return record


def place_command(target: Path, source: SplatScene) -> str:
    """Command that places something in the scene once SuGaR's mesh exists."""
    # the mesh is in metres and z up; its own format does not say so, InteriorGS' annotations do
    frame = "" if source.annotated else " --up z --unit m"
    return f'dcap place {shlex.quote(str(target))} OBJECT "PROMPT"{frame}'


def publish(draft: Path, folder: Path) -> None:
    """Replace the folder by a finished draft, keeping foreign files; on failure everything stays as it was."""
    if not (folder / RECORD).is_file():
        os.replace(draft, folder)  # nothing or an empty folder is there
        return
    # next to the folder, where nothing is cleaned up: it holds files of others
    aside = Path(tempfile.mkdtemp(dir=folder.parent, prefix=f".{folder.name}.old."))
    try:
        os.replace(folder, aside)
        os.replace(draft, folder)
        move_others(aside, folder)
    except BaseException:  # an interruption too
        restore(aside, folder)
        raise
    shutil.rmtree(aside)


def move_others(source: Path, target: Path) -> None:
    """Move files that are not ours."""
    for entry in list(source.iterdir()):
        if entry.name not in OWNED:
            os.replace(entry, target / entry.name)


def restore(aside: Path, folder: Path) -> None:
    """Restore the earlier result with its foreign files, wherever they are by now."""
    if not (aside / RECORD).is_file():
        aside.rmdir()  # it never left its place
        return
    if folder.is_dir():
        move_others(folder, aside)
        shutil.rmtree(folder)
    os.replace(aside, folder)


def summary(folder: Path, record: PreparedScene) -> str:
    """Lines on the result and the next steps."""
    script = shlex.quote(str(folder / "run_sugar.sh"))
    return "\n".join(
        [
            *(f"note: {note}" for note in record.notes),
            f"{record.views} views of {record.splats} splats: {folder}",
            "in the folder of SuGaR, on a machine with a graphics card:",
            f"  {record.command}",
            f"or, to also copy its meshes to where they are found: sh {script} PATH_OF_SUGAR",
            f"then: {record.then}",
        ]
    )


@dataclass(frozen=True, slots=True)
class MeshSource:
    """Origin of a scene's mesh."""

    kind: str
    """GIVEN, SUGAR or OWN."""
    file: str
    """Its path; that of the splats for a surface extracted by dcap."""


def with_sugar(scenes: Mapping[str, Sample], sugar: Path, *, threads: int, quiet: bool) -> dict[str, Sample]:
    """Scenes by name, with a mesh by SuGaR for each splat-only scene; InputError if SuGaR fails."""
    if not (sugar / "train.py").is_file():
        raise InputError(f"--sugar {sugar}: no train.py there; give the folder of SuGaR's repository")
    return {name: sugar_meshed(name, scene, sugar, threads, quiet=quiet) for name, scene in scenes.items()}


def sugar_meshed(name: str, scene: Sample, sugar: Path, threads: int, *, quiet: bool) -> Sample:
    """The scene with SuGaR's mesh, unless it has a mesh of its own."""
    path = Path(scene.scene)
    if not has_only_splats(path):
        return scene
    digest = Store.default().add_source(str(path)).sha256
    folder = runs_root() / "sugar" / f"{slug(Path(name).name)}-{digest[:8]}"
    target = path if path.is_dir() else folder / "mesh"
    if has_only_splats(target) or not target.is_dir():
        if not (folder / RECORD).is_file():
            prepare_sugar(path, folder, scene.scene_options, VIEWS, threads=threads, quiet=quiet)
        run_sugar(folder, sugar, quiet=quiet)
    if not target.is_dir() or mesh_source(target).kind != SUGAR:
        raise InputError(f"{path}: SuGaR ended without a mesh; see {folder / LOG}")
    # SuGaR keeps the world frame of its input; for InteriorGS the annotations give the frame
    frame = scene.scene_options if is_interiorgs(target) else replace(scene.scene_options, up="z", unit="m")
    return replace(scene, scene=str(target), scene_options=frame)


def run_sugar(folder: Path, sugar: Path, *, quiet: bool) -> None:
    """Run the script that prepare-sugar wrote; InputError with its last output if it fails."""
    script = folder / "run_sugar.sh"
    status = Console(file=sys.stderr, quiet=quiet, highlight=False).status(f"SuGaR: {folder.name}")
    with status, (folder / LOG).open("wb") as log:
        code = subprocess.run(
            ["sh", str(script), str(sugar.resolve())], stdin=subprocess.DEVNULL, stdout=log, stderr=log, check=False
        ).returncode
    if code:
        said = (folder / LOG).read_text(encoding="utf-8", errors="replace").split("\n")
        last = next((line.strip() for line in reversed(said) if line.strip()), "it said nothing")
        raise InputError(
            f"--sugar {sugar}: SuGaR failed on {folder} (exit {code}): {last}; all it said: {folder / LOG}"
        )


def mesh_source(scene: Path) -> MeshSource:
    """Origin of a scene's mesh; InputError for a folder without one."""
    if not scene.is_dir() or (is_scannet(scene) and not is_interiorgs(scene)):
        return MeshSource(OWN if has_only_splats(scene) else GIVEN, str(scene))
    file = find_mesh(scene)[0]
    if has_only_splats(scene):
        return MeshSource(OWN, str(file))
    made = {"refined_mesh", "coarse_mesh"} & set(file.relative_to(scene).parts)  # its name alone proves nothing
    return MeshSource(SUGAR if made else GIVEN, str(file))
