"""Files that a mesh file names: MTL files and textures of an OBJ, buffers and pictures of a glTF or a SOG's meta.json.

The store copies what `companions` finds, and the readers find it again with the same functions (files/references.py),
so both always agree.
"""

import re
from collections.abc import Iterator
from mmap import ACCESS_READ, mmap
from pathlib import Path
from urllib.parse import unquote

from dcap.scene.errors import FormatError
from dcap.scene.readers.files.references import MTL_TEXTURES, find_file, library_names, material_lines, texture_beside
from dcap.scene.readers.gltf.document import read_document, uris
from dcap.scene.readers.splats.sog import is_sog_meta, picture_names

USD_ASSET = re.compile(rb"@([^@\r\n]+)@")
"""A name of another file in a USD text."""

LARGEST_TEXT = 64 << 20
"""Largest glTF, MTL or USD text that is searched for names [bytes]."""


def companions(path: Path) -> Iterator[str]:
    """The files that a mesh file names and that exist, by their name relative to its folder."""
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
    """Names between @ in the text form; the binary one hides its names, and a package holds what it needs."""
    if data[:5] == b"#usda":
        for name in dict.fromkeys(USD_ASSET.findall(data[:LARGEST_TEXT])):
            found = find_file(path.parent, name.decode("utf-8", "replace"))
            if found is not None:
                yield found


def _of_sog(path: Path, data: mmap) -> Iterator[str]:
    if is_sog_meta(path):
        yield from (one for name in picture_names(path, bytes(data)) if (one := find_file(path.parent, name)))
