"""Finds the mesh of a folder: SuGaR's output names first, then any single mesh.

Source: SuGaR repository, sugar_extractors/: refined `sugarfine_*.obj` (with texture), coarse `sugarmesh_*.ply`.
"""

import re
from pathlib import Path

from dcap.scene.errors import InputError
from dcap.scene.readers.points.formats import POINT_SUFFIXES, is_points
from dcap.scene.readers.splats.formats import SPLAT_SUFFIXES, is_splats
from dcap.scene.readers.splats.sog import META
from dcap.scene.readers.usd.usd import USD_SUFFIXES
from dcap.scene.text import words_of

MESH_SUFFIXES = (".glb", ".gltf", ".obj", ".ply", ".stl", *USD_SUFFIXES, *SPLAT_SUFFIXES, *POINT_SUFFIXES)

COMPRESSED_NAME = "3dgs_compressed.ply"
"""Name of the splats of a scene in InteriorGS."""

GENERIC_STEMS = {
    "textured", "model", "mesh", "scene", "object", "untitled", "output", "export", "nontextured", "geometry", "meta"
}  # fmt: skip
"""File stems that say nothing about the thing, so that the folder's name is used."""


def check_suffix(path: Path) -> None:
    """Refuse a file with an unknown suffix."""
    if path.suffix.lower() not in MESH_SUFFIXES and not is_splats(path):
        suffix = path.suffix or "no suffix"
        raise InputError(f"{path}: {suffix} is not a mesh format that is read ({', '.join(MESH_SUFFIXES)})")


def find_mesh(folder: Path) -> tuple[Path, tuple[str, ...]]:
    """The mesh of a scene folder, else its Gaussian splats, else its points; with notes on the choice."""
    for pattern in ("*.obj", "refined_mesh/**/*.obj", "output/refined_mesh/**/*.obj"):
        found = sorted(folder.glob(pattern))
        if found:
            return _choose(folder, found)
    for pattern in ("sugarmesh_*.ply", "coarse_mesh/**/sugarmesh_*.ply", "output/coarse_mesh/**/sugarmesh_*.ply"):
        found = sorted(folder.glob(pattern))
        if found:
            return _choose(folder, found)
    shapes = sorted(p for p in folder.iterdir() if p.suffix.lower() in MESH_SUFFIXES and not is_splats(p))
    meshes = [p for p in shapes if not is_points(p)]
    stages = [p for p in meshes if p.suffix.lower() in USD_SUFFIXES]
    meshes = [p for p in meshes if p not in stages]
    splats = None if meshes else find_splats(folder)
    if splats is not None:
        return splats, ()
    meshes = meshes or stages or shapes  # a USD stage next to others shows the same, but needs a library
    if len(meshes) == 1:
        return meshes[0], ()
    if meshes:
        raise InputError(f"{folder}: {len(meshes)} meshes ({', '.join(p.name for p in meshes)}); name one of them")
    raise InputError(
        f"{folder}: no mesh in this folder (looked for {', '.join(MESH_SUFFIXES)} and SuGaR's output folders)"
    )


def find_splats(folder: Path) -> Path | None:
    """The Gaussian splats of a scene folder, whether or not it also has a mesh; None if there are none."""
    files = (p for p in folder.iterdir() if p.suffix.lower() in (".ply", *SPLAT_SUFFIXES) or p.name == META)
    found = sorted(filter(is_splats, files), key=lambda p: (p.name != COMPRESSED_NAME, p.name))
    if len(found) > 1 and found[0].name != COMPRESSED_NAME:
        raise InputError(f"{folder}: {len(found)} files of splats ({', '.join(p.name for p in found)}); name one")
    return found[0] if found else None


def _choose(folder: Path, found: list[Path]) -> tuple[Path, tuple[str, ...]]:
    """Post-processed before raw meshes, then the most triangles according to the name, then the first by name."""
    ranked = sorted(found, key=lambda p: ("postprocessed" not in p.stem, -_number(p, "decim"), str(p)))
    if len(ranked) == 1:
        return ranked[0], ()
    others = ", ".join(str(p.relative_to(folder)) for p in ranked[1:4])
    return ranked[0], (f"{ranked[0].name} chosen among {len(ranked)} meshes (others: {others})",)


def _number(path: Path, key: str) -> int:
    match = re.search(rf"{key}(\d+)", path.stem)
    return int(match.group(1)) if match else 0


def has_only_splats(path: Path) -> bool:
    """Return whether a path is Gaussian splats, or a folder with nothing better."""
    found = _only_shape(path)
    return found is not None and is_splats(found)


def has_no_faces(path: Path) -> bool:
    """Return whether a path is Gaussian splats or points, or a folder with nothing better, so that a surface must be
    found."""
    found = _only_shape(path)
    return found is not None and (is_splats(found) or is_points(found))


def _only_shape(path: Path) -> Path | None:
    """The file from which a source is read; None if a folder has none."""
    if not path.is_dir():
        return path
    try:
        return find_mesh(path)[0]
    except InputError:
        return None


def is_generic(path: Path) -> bool:
    """Return whether a file's name says nothing about the thing."""
    return path.stem.lower() in GENERIC_STEMS or not words_of(path.stem)


def describe(path: Path, folder: str = "") -> str:
    """Name of a mesh: the file's stem, or the folder's name if the stem says nothing; empty if neither is more than a
    number or an id.

    `folder` is the name of the file's original folder, if the file was copied from there. If a file's name is a number
    or an id, no other folder is used to name it, since such a folder may hold many things.
    """
    if not is_generic(path):
        return path.stem
    name = folder or (path.parent.name or path.stem if words_of(path.stem) else "")
    return name if words_of(name) else ""
