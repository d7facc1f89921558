"""Files that a mesh file names: the MTL files and textures of an OBJ, the buffers and pictures of a glTF.

The store copies what `companions` finds, and the readers find it again with the same functions, so both always agree.
Only what lies in the mesh file's own folder counts.
"""

import os
import posixpath
import re
from collections.abc import Iterator
from mmap import ACCESS_READ, mmap
from pathlib import Path
from urllib.parse import unquote

from dcap.scene.errors import FormatError
from dcap.scene.readers.gltf.document import read_document, uris

LARGEST_TEXT = 64 << 20
"""Largest glTF or MTL text that is searched for names [bytes]."""

LIBRARY = re.compile(rb"(?:^|[\r\n])[ \t]*mtllib[ \t]+([^\r\n]+)")
"""A line of an OBJ that names an MTL file."""


def companions(path: Path) -> Iterator[str]:
    """The files that a mesh file names and that exist, by their name relative to its folder."""
    search = {".obj": _of_obj, ".gltf": _of_gltf, ".glb": _of_gltf}.get(path.suffix.lower())
    if search is not None:
        with path.open("rb") as file, mmap(file.fileno(), 0, access=ACCESS_READ) as data:
            yield from search(path, data)


def beside(folder: Path, name: str, base: str = "") -> str | None:
    """The file in `folder` that `name` means, relative to it; None if there is none.

    `base` is where in the folder the name was written. A name that leads out of the folder (absolute, or with `..`) was
    written for a place that only its writer has: its longest ending that exists in the folder is taken.
    """
    tidy = _tidy(name, base)
    parts = [part for part in tidy.split("/") if part not in ("", "..")]
    endings = range(len(parts)) if _leads_out(tidy) else range(1)
    found = ("/".join(parts[start:]) for start in endings)
    # os.path.isfile: a name that no file can have (too long, a zero byte) is False, not an exception
    return next((one for one in found if os.path.isfile(folder / one)), None)


def absence(name: str, base: str = "") -> str:
    """Why `beside` found nothing, to end a sentence with."""
    return "lies outside of the file's folder" if _leads_out(_tidy(name, base)) else "is missing"


def _tidy(name: str, base: str) -> str:
    without_drive = re.sub("^[A-Za-z]:/", "/", name.replace("\\", "/"))
    return posixpath.normpath(posixpath.join(base, without_drive))


def _leads_out(tidy: str) -> bool:
    return tidy.startswith("/") or tidy.split("/")[0] == ".."


def library_names(data: bytes | mmap) -> list[str]:
    """Names after `mtllib` in an OBJ, in order, each once."""
    names = (match.group(1).decode("utf-8", "replace").strip() for match in LIBRARY.finditer(data))
    return [name for name in dict.fromkeys(names) if name]


def material_lines(path: Path) -> Iterator[tuple[int, str, str]]:
    """Line number, keyword and the rest of each line of an MTL file."""
    for number, line in enumerate(path.read_text("utf-8", errors="replace").splitlines(), start=1):
        key, _, rest = line.strip().replace("\t", " ").partition(" ")
        yield number, key, rest.strip()


def texture_beside(folder: Path, library: str, text: str) -> str | None:
    """The image that `map_Kd TEXT` of an MTL file means: the whole text, or its last word where options precede it."""
    base = posixpath.dirname(library)
    names = (text, text.split()[-1]) if text else ()
    return next((found for name in names if (found := beside(folder, name, base))), None)


def _of_obj(path: Path, data: mmap) -> Iterator[str]:
    for name in library_names(data):
        library = beside(path.parent, name)
        if library is None:
            continue
        yield library
        if (path.parent / library).stat().st_size <= LARGEST_TEXT:
            textures = (rest for _, key, rest in material_lines(path.parent / library) if key == "map_Kd")
            yield from (one for text in textures if (one := texture_beside(path.parent, library, text)))


def _of_gltf(path: Path, data: mmap) -> Iterator[str]:
    text_size = int.from_bytes(data[12:16], "little") if data[:4] == b"glTF" else len(data)
    if text_size > LARGEST_TEXT:
        raise FormatError(f"{path}: {text_size} bytes of glTF text > {LARGEST_TEXT}; save it as GLB with its buffers")
    for uri in uris(path, read_document(path, data)[0]):
        found = beside(path.parent, unquote(uri))
        if found is not None:
            yield found
