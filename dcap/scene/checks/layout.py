"""Finds the scenes and the single meshes in a dataset folder.

A scene is a folder with annotations (InteriorGS), one of ScanNet, or one with SuGaR's folder tree, one mesh or one
file of splats.
Several meshes in one folder are a collection of single meshes. Every other folder is searched, whatever its name.
"""

import re
from dataclasses import dataclass, field
from pathlib import Path

from dcap.scene.checks.findings import Findings
from dcap.scene.problems import error, note
from dcap.scene.readers.files.references import GROUND_TRUTH
from dcap.scene.readers.scenes.interiorgs import is_interiorgs
from dcap.scene.readers.scenes.scannet import is_scannet
from dcap.scene.readers.scenes.sugar import MESH_SUFFIXES

NUMBERED = re.compile(r"\d{4}_\w+")
"""Pattern of InteriorGS's scene folders: 0001_839920."""
MARKS = ("occupancy.json", "occupancy.png", "3dgs_compressed.ply")
"""Other files that only a scene folder has."""
SUGAR_TREE = ("refined_mesh", "coarse_mesh", "output")
"""Folders in which SuGaR leaves its meshes."""
NOT_DATA = ("cache", "runs", *GROUND_TRUTH)
"""Folders of our own next to the data: results, and files that no stage may read."""


@dataclass(slots=True)
class Layout:
    """Paths of the scenes and the single meshes."""

    scenes: list[Path] = field(default_factory=list)
    meshes: list[Path] = field(default_factory=list)
    empty: list[Path] = field(default_factory=list)
    """Folders with neither."""


def layout_of(path: Path, findings: Findings) -> Layout:
    """Scenes and meshes below a folder, or the scene or mesh that it is itself."""
    if not path.is_dir():
        return Layout(meshes=[path])
    found = _searched(path, findings)
    for folder in found.empty:
        findings.report(folder)(note("nothing in this folder is a scene or a mesh"))
    if not found.scenes and not found.meshes:
        findings.report(path)(error(f"no scene in this folder: neither labels.json nor {', '.join(MESH_SUFFIXES)}"))
    return found


def is_marked(folder: Path) -> bool:
    """Whether the files or the name of a folder mark it as one scene."""
    if is_interiorgs(folder) or is_scannet(folder) or NUMBERED.fullmatch(folder.name):
        return True
    if any((folder / name).is_file() for name in MARKS):
        return True
    trees = [folder / tree for tree in SUGAR_TREE]
    return any(file.suffix in (".obj", ".ply") for tree in trees if tree.is_dir() for file in tree.rglob("*.*"))


def mesh_files(folder: Path) -> list[Path]:
    """Meshes and splats that lie in a folder itself."""
    return sorted(one for one in folder.iterdir() if one.suffix.lower() in MESH_SUFFIXES and one.is_file())


def _searched(folder: Path, findings: Findings) -> Layout:
    try:
        if is_marked(folder):
            return Layout(scenes=[folder])
        meshes = mesh_files(folder)
        children = sorted(one for one in folder.iterdir() if one.is_dir() and not one.is_symlink())
    except OSError as broken:
        findings.report(folder)(error(f"cannot be read: {broken.strerror}"))
        return Layout()
    children = [one for one in children if not one.name.startswith(".") and one.name.lower() not in NOT_DATA]
    below = [_searched(child, findings) for child in children]
    found = Layout()
    for layout in below:
        found.scenes += layout.scenes
        found.meshes += layout.meshes
        found.empty += layout.empty
    if len(meshes) == 1 and not found.scenes and not found.meshes:
        return Layout(scenes=[folder])  # folders below hold its textures
    found.meshes[:0] = meshes
    if not meshes and not children:
        found.empty.append(folder)
    return found
