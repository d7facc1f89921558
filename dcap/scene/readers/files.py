"""Content of foreign files: bytes, JSON, YAML 1.2 and images within limits, and files that they refer to.

Unreadable content is refused with one line that names the file and the place. A file can only refer to files in its own
folder.

Images of foreign files: decoded to sRGB bytes, with a limit on the size of each and of all of one file.

The size is read from the header and checked before a pixel is decoded: a PNG of a single colour packs a thousand pixels
into a byte. Only formats of textures and photographs are decoded, and none by another program (PostScript).

Files that another file refers to by name: only those in the naming file's own folder count.

Hidden files and ground truth do not count, and a link on the way to a file, or to a folder, counts as its target
(decision 096).
"""

import io
import json
import os
import posixpath
import re
import struct
import zlib
from collections.abc import Iterator
from mmap import mmap
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from PIL import Image, UnidentifiedImageError
from ruamel.yaml import YAML
from ruamel.yaml.constructor import ConstructorError, SafeConstructor
from ruamel.yaml.error import MarkedYAMLError, YAMLError
from ruamel.yaml.nodes import MappingNode

from dcap.scene.errors import FormatError, InputError

MAX_FILE_BYTES = 4 * 1024**3
"""Largest file that is opened [bytes]."""
WIDEST = 1_000_000
"""Longest line of a YAML file that is written: texts are not broken."""
MOST_KEYS = 10_000
"""Maximum number of keys in one mapping, more than anyone writes; repeated merges can create any number from a short
file."""
BROKEN_YAML = (YAMLError, ValueError, RecursionError)
"""Errors that `parse_yaml` raises for text that is not YAML."""
LONGEST_SIDE = 8192
MAX_PIXELS = LONGEST_SIDE * LONGEST_SIDE
"""Largest image [pixels]: 200 MB decoded; a texture of SuGaR has 7071 x 7071."""
MAX_TOGETHER = 4 * MAX_PIXELS
"""Largest number of pixels of all images of one file [-]."""
FORMATS = ("PNG", "JPEG", "WEBP", "TIFF", "TGA", "BMP", "DDS", "GIF", "PPM")
"""Formats that are decoded, by Pillow's names; a camera's file of several JPEGs counts too."""

UNREADABLE = (OSError, SyntaxError, ValueError, LookupError, EOFError, struct.error, zlib.error)
"""Errors that decoding can raise for bytes that are not an image, or a truncated one."""

# Pillow's own limit is lower and warns in several lines; ours is checked between the header and the pixels.
Image.MAX_IMAGE_PIXELS = None
LIBRARY = re.compile(rb"(?:^(?:\xef\xbb\xbf)?|[\r\n])[ \t]*mtllib[ \t]+([^\r\n]+)")
"""A line of an OBJ that names an MTL file; the first line may follow a byte order mark."""

COMMENT = re.compile(r"(?:^|\s)#")
"""Possible beginning of a comment after a name; a name may contain the sign too ("Material #25")."""

MTL_TEXTURES = ("map_Kd", "map_d", "map_Ke", "norm")
"""Keywords of an MTL file whose images are read."""

GROUND_TRUTH = ("truth", "ground_truth", "groundtruth", "ground-truth")
"""Stems of files that no stage may see."""


def read_bytes(path: Path, most: int = -1) -> bytes:
    """The whole file, or its first bytes; a missing, empty or oversized file is refused with one line."""
    if not path.is_file():
        raise InputError(f"{path}: no such file")
    size = path.stat().st_size
    if size == 0:
        raise FormatError(f"{path}: the file is empty")
    if size > MAX_FILE_BYTES:
        raise InputError(
            f"{path}: {size / 1024**3:.1f} GiB > {MAX_FILE_BYTES / 1024**3:.0f} GiB; decimate the mesh first"
        )
    with path.open("rb") as stream:
        return stream.read(most)


def read_json(path: Path) -> object:
    """The tree of a JSON file in UTF-8, with or without a byte order mark."""
    return parse_json(path, read_bytes(path), "JSON")


def parse_json(path: Path, text: bytes, what: str) -> object:
    """The tree of a JSON text; `what` names it in messages."""
    try:
        tree: object = json.loads(text.decode("utf-8-sig"))
        if b"\\ud" in text or b"\\uD" in text:  # halves of surrogate pairs parse, but cannot be written again
            json.dumps(tree, ensure_ascii=False).encode()
    except UnicodeEncodeError:
        raise FormatError(f"{path}: broken {what}: a string contains an unpaired surrogate") from None
    except (ValueError, RecursionError) as error:
        raise FormatError(f"{path}: broken {what}: {error}") from None
    return tree


class BoundedMerges(SafeConstructor):
    """Refuses mappings that grow without limit by merging (`<<`) each other."""

    def flatten_mapping(self, node: MappingNode) -> None:
        """Merge the keys of merged mappings into a mapping."""
        super().flatten_mapping(node)
        if len(node.value) > MOST_KEYS:
            what = f"merging makes {len(node.value)} keys of one mapping, expected at most {MOST_KEYS}"
            raise ConstructorError(None, None, what, node.start_mark)


def yaml_fault(broken: Exception) -> str:
    """Fault in a text that `parse_yaml` refuses, with its place, in one line."""
    if not isinstance(broken, MarkedYAMLError) or broken.problem_mark is None:
        return " ".join(str(broken).split())
    mark, what = broken.problem_mark, ": ".join(one for one in (broken.context, broken.problem) if one)
    return f"line {mark.line + 1}, column {mark.column + 1}: {' '.join(what.split())}"


def parse_yaml(text: str) -> object:
    """The tree of a YAML 1.2 text; its parts may be shared, so that it may be infinite when written out."""
    yaml = YAML(typ="safe", pure=True)
    yaml.Constructor = BoundedMerges
    tree: object = yaml.load(text)
    return tree


def yaml_text(tree: object) -> str:
    """A tree of plain values as YAML 1.2, keys in their order, a line for each value."""
    yaml: Any = YAML(typ="safe", pure=True)  # its attributes are typed as their defaults
    text = io.StringIO()
    yaml.default_flow_style, yaml.sort_base_mapping_type_on_output = False, False
    yaml.allow_unicode, yaml.width = True, WIDEST
    yaml.dump(tree, text)
    return text.getvalue()


def read_image(data: bytes, where: str) -> NDArray[np.uint8]:
    """An encoded image as RGB bytes, first row on top, shape (h, w, 3); transparency is ignored."""
    return _decoded(data, where, "RGB", MAX_PIXELS)


def read_transparent(data: bytes, where: str) -> NDArray[np.uint8]:
    """An encoded image with its transparency, (h, w, 4), or as RGB bytes, (h, w, 3), if every pixel is opaque."""
    image = _decoded(data, where, "RGBA", MAX_PIXELS)
    return image if (image[..., 3] < 255).any() else np.ascontiguousarray(image[..., :3])


def read_gray(data: bytes, where: str, most: int) -> NDArray[np.uint8]:
    """An encoded image of at most `most` pixels as grey bytes, first row on top, shape (h, w)."""
    return _decoded(data, where, "L", most)


def read_rgba(data: bytes, where: str, most: int) -> NDArray[np.uint8]:
    """An encoded image of at most `most` pixels with its transparency unchanged, first row on top, shape (h, w, 4)."""
    return _decoded(data, where, "RGBA", most)


class PixelBudget:
    """Total number of pixels allowed for the images of one file."""

    def __init__(self, path: Path) -> None:
        self._path, self._left = path, MAX_TOGETHER

    def spend(self, image: NDArray[np.uint8]) -> NDArray[np.uint8]:
        """The image; raises FormatError if the budget is exceeded."""
        self._left -= image.shape[0] * image.shape[1]
        if self._left < 0:
            raise FormatError(
                f"{self._path}: its images have more than {MAX_TOGETHER} pixels together; reduce them first"
            )
        return image


def check_size(size: tuple[int, int], where: str, most: int = MAX_PIXELS) -> None:
    """Raise FormatError for an image of more than `most` pixels, from its width and height [pixel]."""
    width, height = size
    if width * height > most:
        raise FormatError(f"{where}: an image of {width} x {height} pixels, more than {most}; reduce it first")


def _decoded(data: bytes, where: str, mode: str, most: int) -> NDArray[np.uint8]:
    try:
        with Image.open(io.BytesIO(data), formats=FORMATS) as image:
            check_size(image.size, where, most)
            if mode == "L" and image.mode.startswith(("I", "F")):  # conversion would clip its values, not scale them
                raise FormatError(f"{where}: an image with more than 8 bits per pixel; convert it to grey of 8 bits")
            return np.asarray(image.convert(mode), dtype=np.uint8)
    except UnidentifiedImageError:  # its message contains an address in memory
        raise FormatError(f"{where}: the image cannot be decoded (none of the known formats)") from None
    except UNREADABLE as error:
        raise FormatError(f"{where}: the image cannot be decoded ({error})") from None


def find_file(folder: Path, name: str, base: str = "") -> str | None:
    """The file in `folder` to which `name` refers, relative to the folder; None if there is none.

    `base` is the place in the folder where the name was written. A name that leads out of the folder (absolute, or with
    `..`) was written for a place that only its author has: its longest ending that exists in the folder is used. Raises
    InputError if a link on the way to the file leads out of the folder.
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
    """Refuse a name below a folder that links lead out of the folder's own files: a dataset would take foreign files
    along, or ground truth. Links above the folder are the user's own."""
    home, target = (Path(os.path.realpath(one)) for one in (folder, folder / name))
    if target.is_relative_to(home) and may_be_seen(target.relative_to(home)):
        return
    file = folder / name
    way = [file, *file.parents[: len(Path(name).parts) - 1]]
    link = next((one for one in reversed(way) if not Path(os.path.realpath(one)).is_relative_to(home)), file)
    where = os.path.realpath(link)
    raise InputError(f"{link}: a link to {where}, which is not a file of the scene; put a copy in its place (cp -rL)")


def may_be_seen(name: Path) -> bool:
    """Return whether a file of a folder is neither hidden nor ground truth."""
    return not any(part.startswith(".") for part in name.parts) and name.stem.lower() not in GROUND_TRUTH


def absence(name: str, base: str = "") -> str:
    """Reason why `find_file` found nothing, as the end of a sentence."""
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

    A line is a single name if such a file exists, with or without the comment, since names may contain blanks.
    Otherwise it is several names if at least one of them exists, as the format allows.
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
    """The names that the end of a line may stand for: the whole text, then without possible comments, the longest
    first."""
    return [text, *(text[: match.start()].strip() for match in reversed(list(COMMENT.finditer(text))))]


def material_lines(path: Path) -> Iterator[tuple[int, str, str]]:
    """Line number, keyword and the rest of each line of an MTL file."""
    for number, line in enumerate(path.read_text("utf-8-sig", errors="replace").splitlines(), start=1):
        key, _, rest = line.strip().replace("\t", " ").partition(" ")
        yield number, key, rest.strip()


def texture_beside(folder: Path, library: str, text: str) -> str | None:
    """The image to which `map_Kd TEXT`, or another keyword with an image, refers in an MTL file: the whole text, or its
    last word if options precede it."""
    base = posixpath.dirname(library)
    names = (text, text.split()[-1]) if text else ()
    return next((found for name in names if (found := find_file(folder, name, base))), None)
