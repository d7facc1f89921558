"""Which files make up a foreign scene or mesh: the file itself and what it names.

A folder gives all its files; an OBJ brings its MTL files and their textures, a glTF its buffers and pictures. Only what
lies in the file's own folder counts, and ground truth never does. Absurd inputs are refused before anything is read.
"""

import json
from collections.abc import Iterable, Iterator
from pathlib import Path
from urllib.parse import unquote

from scene.errors import FormatError, InputError

MOST_BYTES = 4 << 30
"""Largest input in total; the largest InteriorGS scene or SuGaR mesh is well below 1 GiB."""
MOST_FILES = 2000
"""Most files of a scene folder; more means that the wrong folder was given."""
LARGEST_TEXT = 64 << 20
"""Largest glTF or MTL text that is searched for names [bytes]."""
GROUND_TRUTH = ("truth", "ground_truth", "groundtruth", "ground-truth")
"""Stems of files that no stage may see."""


def source_files(path: Path) -> tuple[str, dict[str, Path]]:
    """Name of the main file (`.` for a folder) and all files by their name relative to the main file's folder."""
    if not path.exists():
        raise InputError(f"{path}: no such file or folder")
    if path.is_dir():
        return ".", checked(path, folder_files(path))
    companions = {"obj": obj_companions, "gltf": gltf_companions}.get(path.suffix.lower().lstrip("."))
    files = {path.name: path}
    check_size(path, path.stat().st_size)
    for name in companions(path) if companions else ():
        found = path.parent / name
        if found.is_file() and found.resolve().is_relative_to(path.parent.resolve()):
            files[Path(name).as_posix()] = found
    return path.name, checked(path, files.items())


def checked(path: Path, files: Iterable[tuple[str, Path]]) -> dict[str, Path]:
    """The files by name, if they are neither too many nor too large nor none."""
    found: dict[str, Path] = {}
    total = 0
    for name, file in files:
        found[name] = file
        total += file.stat().st_size
        check_size(path, total)
        if len(found) > MOST_FILES:
            raise InputError(f"{path}: more than {MOST_FILES} files; give the folder of one scene")
    if not found:
        raise InputError(f"{path}: an empty folder")
    return found


def check_size(path: Path, size: int) -> None:
    """Refuse what cannot be a sensible input."""
    if size > MOST_BYTES:
        limit = MOST_BYTES / 2**30
        raise InputError(f"{path}: {size / 2**30:.1f} GiB > {limit:.0f} GiB; decimate the mesh or give one scene")
    if size == 0 and path.is_file():
        raise InputError(f"{path}: an empty file")


def folder_files(folder: Path) -> Iterator[tuple[str, Path]]:
    """All plain files below a folder but hidden ones and ground truth."""
    for file in folder.rglob("*"):
        name = file.relative_to(folder)
        hidden = any(part.startswith(".") for part in name.parts)
        if file.is_file() and not hidden and file.stem.lower() not in GROUND_TRUTH:
            yield name.as_posix(), file


def obj_companions(path: Path) -> Iterator[str]:
    """Names after `mtllib` in the OBJ and after `map_*` in those MTL files."""
    with path.open("rb") as lines:
        libraries = [
            line.decode("utf-8", "replace").split(maxsplit=1)[1].strip()
            for line in lines
            if line.startswith(b"mtllib ") and len(line) < 4096
        ]
    for library in dict.fromkeys(libraries):
        material = path.parent / library
        if material.is_file() and material.stat().st_size < LARGEST_TEXT:
            yield library
            yield from (str(Path(library).parent / name) for name in mtl_textures(material))


def mtl_textures(path: Path) -> Iterator[str]:
    """File names of `map_Kd [options] NAME` lines: the rest of the line, and its last word where options precede it."""
    for line in path.read_text("utf-8", "replace").splitlines():
        words = line.split(maxsplit=1)
        if len(words) == 2 and (words[0].lower().startswith("map_") or words[0].lower() in ("bump", "norm", "disp")):
            yield words[1].strip()
            yield words[1].split()[-1]


def gltf_companions(path: Path) -> Iterator[str]:
    """Relative URIs of buffers and images."""
    if path.stat().st_size > LARGEST_TEXT:
        raise FormatError(f"{path}: {path.stat().st_size} bytes of glTF text > {LARGEST_TEXT}; save it as GLB")
    try:
        tree = json.loads(path.read_bytes())
        entries = [*tree.get("buffers", []), *tree.get("images", [])]
        uris = [str(entry["uri"]) for entry in entries if "uri" in entry]
    except (ValueError, AttributeError, TypeError) as error:
        raise FormatError(f"{path}: not a glTF file: {error}") from error
    yield from (unquote(uri) for uri in uris if not uri.startswith("data:"))
