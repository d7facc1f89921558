"""Files that another file refers to by name: only those in the naming file's own folder count.

Neither hidden files nor ground truth count, and a link on the way to a file, be it to a folder, counts as what it leads
to (decision 096).
"""

import os
import posixpath
import re
from collections.abc import Iterator
from mmap import mmap
from pathlib import Path

from dcap.scene.errors import InputError

LIBRARY = re.compile(rb"(?:^(?:\xef\xbb\xbf)?|[\r\n])[ \t]*mtllib[ \t]+([^\r\n]+)")
"""A line of an OBJ that names an MTL file; the first one may follow a byte order mark."""

COMMENT = re.compile(r"(?:^|\s)#")
"""Where a comment behind a name may begin; a name may hold the sign too ("Material #25")."""

MTL_TEXTURES = ("map_Kd", "map_d", "map_Ke", "norm")
"""Keywords of an MTL file whose images are read."""

GROUND_TRUTH = ("truth", "ground_truth", "groundtruth", "ground-truth")
"""Stems of files that no stage may see."""


def find_file(folder: Path, name: str, base: str = "") -> str | None:
    """The file in `folder` that `name` means, relative to it; None if there is none.

    `base` is where in the folder the name was written. A name that leads out of the folder (absolute, or with `..`) was
    written for a place that only its writer has: its longest ending that exists in the folder is taken. InputError
    where a link on the way to the file leads out of the folder.
    """
    tidy = _tidy(name, base)
    parts = [part for part in tidy.split("/") if part not in ("", "..")]
    endings = range(len(parts)) if _leads_out(tidy) else range(1)
    found = ("/".join(parts[start:]) for start in endings)
    # os.path.isfile: a name that no file can have (too long, a zero byte) is False, not an exception
    one = next((one for one in found if may_be_seen(Path(one)) and os.path.isfile(folder / one)), None)
    if one is not None:
        check_links(folder, one)
    return one


def check_links(folder: Path, name: str) -> None:
    """Refuse a name below a folder that links lead to what is not among the folder's own files: a data set would take
    foreign ones along, or truth. Links above the folder are a person's own."""
    home, target = (Path(os.path.realpath(one)) for one in (folder, folder / name))
    if target.is_relative_to(home) and may_be_seen(target.relative_to(home)):
        return
    file = folder / name
    way = [file, *file.parents[: len(Path(name).parts) - 1]]
    link = next((one for one in reversed(way) if not Path(os.path.realpath(one)).is_relative_to(home)), file)
    where = os.path.realpath(link)
    raise InputError(f"{link}: a link to {where}, which is no file of the scene; put a copy in its place (cp -rL)")


def may_be_seen(name: Path) -> bool:
    """Whether a file of a folder is neither hidden nor ground truth."""
    return not any(part.startswith(".") for part in name.parts) and name.stem.lower() not in GROUND_TRUTH


def absence(name: str, base: str = "") -> str:
    """Why `find_file` found nothing, to end a sentence with."""
    tidy = _tidy(name, base)
    if _leads_out(tidy):
        return "lies outside of the file's folder"
    return "is missing" if may_be_seen(Path(tidy)) else "is a hidden file or ground truth, which no mesh may name"


def _tidy(name: str, base: str) -> str:
    without_drive = re.sub("^[A-Za-z]:/", "/", name.replace("\\", "/"))
    return posixpath.normpath(posixpath.join(base, without_drive))


def _leads_out(tidy: str) -> bool:
    return tidy.startswith("/") or tidy.split("/")[0] == ".."


def library_names(folder: Path, data: bytes | mmap) -> list[str]:
    """Names after `mtllib` in an OBJ of `folder`, in order, each once.

    A line is one name if there is such a file, with or without its comment: names hold blanks. Otherwise it is several
    names if there is one of them, as the format has it.
    """
    lines = (match.group(1).decode("utf-8", "replace").strip() for match in LIBRARY.finditer(data))
    return list(dict.fromkeys(name for line in dict.fromkeys(lines) if line for name in _names_of(folder, line)))


def _names_of(folder: Path, line: str) -> list[str]:
    meant = meanings(line)
    whole = next((name for name in meant if find_file(folder, name) is not None), None)
    if whole is not None:
        return [whole]
    words = meant[-1].split()
    return words if any(find_file(folder, word) is not None for word in words) else [line]


def meanings(text: str) -> list[str]:
    """The names that the end of a line may mean: all of it, then without what may be a comment, the longest first."""
    return [text, *(text[: match.start()].strip() for match in reversed(list(COMMENT.finditer(text))))]


def material_lines(path: Path) -> Iterator[tuple[int, str, str]]:
    """Line number, keyword and the rest of each line of an MTL file."""
    for number, line in enumerate(path.read_text("utf-8-sig", errors="replace").splitlines(), start=1):
        key, _, rest = line.strip().replace("\t", " ").partition(" ")
        yield number, key, rest.strip()


def texture_beside(folder: Path, library: str, text: str) -> str | None:
    """The image that `map_Kd TEXT`, or another keyword with an image, means in an MTL file: the whole text, or its last
    word where options precede it."""
    base = posixpath.dirname(library)
    names = (text, text.split()[-1]) if text else ()
    return next((found for name in names if (found := find_file(folder, name, base))), None)
