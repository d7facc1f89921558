"""Meshes by SuGaR for scenes that only have Gaussian splats, if SuGaR's folder is named.

In: scenes. Out: the same scenes, each with a mesh; SuGaR's are where the script of `dcap dataset prepare-sugar` copies
them. A scene that has a mesh already is skipped, so an interrupted run resumes with the next scene.
"""

import subprocess
import sys
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path

from rich.console import Console

from dcap.geometry.splatting.camera_path import PathConfig
from dcap.scene.errors import InputError
from dcap.scene.readers.scenes.interiorgs import is_interiorgs
from dcap.scene.readers.scenes.scannet import is_scannet
from dcap.scene.readers.scenes.sugar import find_mesh, has_only_splats
from dcap.scene.settings import runs_root
from dcap.scene.types.sample import Sample
from flows.prepare_sugar import RECORD, prepare_sugar
from flows.sample_files import slug
from tasks.artifact import Store

LOG = "sugar.log"
"""Log of SuGaR, next to its input."""
VIEWS = PathConfig()
"""Pictures of each scene for SuGaR."""
GIVEN, SUGAR, OWN = "given", "SuGaR", "reconstructed from the splats"


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
