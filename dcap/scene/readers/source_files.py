"""The files that make up a foreign scene or mesh: the file itself and the files that it names.

A folder contributes all its files, a folder of ScanNet only those that are read (its recordings take gigabytes), and a
folder written by a placement those that make up its scene; an OBJ brings its MTL files and their textures, a glTF its
buffers and pictures. Only files in the file's own folder count, and never ground truth: a link that leads elsewhere is
refused (decision 096). Oversized input and names that are not text are refused before reading.

Files named by a mesh file: MTL files and textures of an OBJ, buffers and pictures of a glTF or a SOG's meta.json.

The store copies the files found by `companions`, and the readers find them with the same functions (readers/files.py),
so both always agree.
"""

import os
import re
from collections.abc import Iterable, Iterator
from mmap import ACCESS_READ, mmap
from pathlib import Path
from unicodedata import category
from urllib.parse import unquote

from dcap.scene.errors import FormatError, InputError
from dcap.scene.readers.files import (
    MTL_TEXTURES,
    check_links,
    find_file,
    library_names,
    material_lines,
    may_be_seen,
    texture_beside,
)
from dcap.scene.readers.gltf.document import read_document, uris
from dcap.scene.readers.scenes.interiorgs import is_interiorgs
from dcap.scene.readers.scenes.placed_scene import is_placed_scene, placed_scene_files
from dcap.scene.readers.scenes.scannet import scannet_files
from dcap.scene.readers.scenes.sugar import MESH_SUFFIXES, check_suffix, is_generic
from dcap.scene.readers.splats.sog import META, is_sog_meta, picture_names
from dcap.scene.text import says_something, words_of

USD_ASSET = re.compile(rb"@([^@\r\n]+)@")
"""A name of another file in a USD text."""

LARGEST_TEXT = 64 << 20
"""Largest glTF, MTL or USD text that is searched for names [bytes]."""
MOST_BYTES = 4 << 30
"""Largest total input; the largest InteriorGS scene or SuGaR mesh is well below 1 GiB."""
MOST_FILES = 2000
"""Maximum number of files of a scene folder; more means that the wrong folder was given."""
NO_TEXT = ("Cc", "Cs")
"""Categories of control characters, including line breaks, and of bytes that are not UTF-8."""


def companions(path: Path) -> Iterator[str]:
    """The existing files named by a mesh file, relative to its folder."""
    search = {
        ".obj": _of_obj,
        ".gltf": _of_gltf,
        ".glb": _of_gltf,
        ".json": _of_sog,
        ".usd": _of_usda,
        ".usda": _of_usda,
    }.get(path.suffix.lower())
    if search is not None:
        with path.open("rb") as file, mmap(file.fileno(), 0, access=ACCESS_READ) as data:
            yield from search(path, data)


def _of_obj(path: Path, data: mmap) -> Iterator[str]:
    for name in library_names(path.parent, data):
        library = find_file(path.parent, name)
        if library is None:
            continue
        yield library
        if (path.parent / library).stat().st_size <= LARGEST_TEXT:
            textures = (rest for _, key, rest in material_lines(path.parent / library) if key in MTL_TEXTURES)
            yield from (one for text in textures if (one := texture_beside(path.parent, library, text)))


def _of_gltf(path: Path, data: mmap) -> Iterator[str]:
    text_size = int.from_bytes(data[12:16], "little") if data[:4] == b"glTF" else len(data)
    if text_size > LARGEST_TEXT:
        raise FormatError(f"{path}: {text_size} bytes of glTF text > {LARGEST_TEXT}; save it as GLB with its buffers")
    for uri in uris(path, read_document(path, data)[0]):
        found = find_file(path.parent, unquote(uri))
        if found is not None:
            yield found


def _of_usda(path: Path, data: mmap) -> Iterator[str]:
    """Names between @ in the text form; the binary form hides its names, and a package contains all its files."""
    if data[:5] == b"#usda":
        for name in dict.fromkeys(USD_ASSET.findall(data[:LARGEST_TEXT])):
            found = find_file(path.parent, name.decode("utf-8", "replace"))
            if found is not None:
                yield found


def _of_sog(path: Path, data: mmap) -> Iterator[str]:
    if is_sog_meta(path):
        yield from (one for name in picture_names(path, bytes(data)) if (one := find_file(path.parent, name)))


def source_files(path: Path) -> tuple[str, dict[str, Path]]:
    """Name of the main file (`.` for a folder), and all files by their name relative to the main file's folder."""
    if not path.exists():
        raise InputError(f"{path}: no such file or folder")
    if is_placed_scene(path):  # its pictures and timings are not part of the scene
        return ".", checked(path, ((file.name, file) for file in placed_scene_files(path)))
    if path.is_dir():
        scannet = None if is_interiorgs(path) else scannet_files(path)
        files = folder_files(path) if scannet is None else ((file.name, file) for file in scannet.present)
        return ".", checked(path, files)
    if not path.is_file():
        raise InputError(f"{path}: neither a file nor a folder")
    check_suffix(path)
    check_size(path, path.stat().st_size)
    named = {path.name: path} | {name: path.parent / name for name in companions(path)}
    return path.name, checked(path, named.items())


def telling_folder(path: Path, files: Iterable[str]) -> str:
    """Name of the folder if it describes the mesh better than the file's name; else empty.

    `files` are the names from `source_files`. A scene with annotations gets no name. A mesh whose name is a number or
    an id is named after its folder only if it is the only mesh there.
    """
    folder = Path(os.path.abspath(path if path.is_dir() else path.parent))
    if is_placed_scene(path) or (path.is_dir() and (is_interiorgs(path) or scannet_files(path) is not None)):
        return ""
    top = (Path(name) for name in files if "/" not in name)
    meshes = (one for one in top if one.suffix.lower() in MESH_SUFFIXES or one.name == META)
    generic = next((mesh for mesh in meshes if is_generic(mesh)), None)
    if generic is None:
        return ""
    if words_of(generic.stem):
        return folder.name or generic.stem  # the root folder has no name
    alone = sum(one.suffix.lower() in MESH_SUFFIXES for one in folder.iterdir()) == 1
    return folder.name if alone and says_something(folder.name) else ""


def checked(path: Path, files: Iterable[tuple[str, Path]]) -> dict[str, Path]:
    """The files by name; raises if there are too many, none, or too large ones."""
    found: dict[str, Path] = {}
    total = 0
    for name, file in files:
        check_name(path, name)
        if file != path:  # the path given by a person may be a link
            check_links(path if path.is_dir() else path.parent, name)
        found[name] = file
        total += file.stat().st_size
        check_size(path, total)
        if len(found) > MOST_FILES:
            raise InputError(f"{path}: more than {MOST_FILES} files; give the folder of one scene")
    if not found:
        raise InputError(f"{path}: an empty folder")
    return found


def check_name(path: Path, name: str) -> None:
    """Refuse a name that is not text, or that could be read as two lines of a list or as a path on another system."""
    if "\\" in name or any(category(one) in NO_TEXT for one in name):
        raise InputError(f"{path}: the file name {name!r} has characters that are not text, or a backslash; rename it")


def check_size(path: Path, size: int) -> None:
    """Refuse files that are too large to be sensible input."""
    if size > MOST_BYTES:
        limit = MOST_BYTES / 2**30
        raise InputError(f"{path}: {size / 2**30:.1f} GiB > {limit:.0f} GiB; decimate the mesh or give one scene")
    if size == 0 and path.is_file():
        raise InputError(f"{path}: an empty file")


def folder_files(folder: Path) -> Iterator[tuple[str, Path]]:
    """All regular files below a folder except hidden ones and ground truth."""
    for file in folder.rglob("*"):
        name = file.relative_to(folder)
        if file.is_file() and may_be_seen(name):
            yield name.as_posix(), file
