"""Selects scenes of a data set: names between commas, a file of names, or a split in the data set's folder.

A scene is named by its path below the folder that all scenes share, or else by the end of its path, with or without its
suffix: `bedroom_01`, `house_2/kitchen`. Where both fit, the first counts: `kitchen` is not `house_2/kitchen` then. In a
file each name has a line; what follows a `#` is a remark. `val` means `val.txt` next to the data set, if there is one.
"""

import os
from collections.abc import Sequence
from pathlib import Path, PurePosixPath

from dcap.scene.errors import InputError
from dcap.scene.readers.scenes.sugar import MESH_SUFFIXES
from dcap.scene.text import did_you_mean, first_of
from dcap.scene.types.sample import Sample

SPLIT_SUFFIX = ".txt"
SHOWN = 5
"""Most scenes that a message lists."""


def named_scenes(text: str, folder: Path) -> tuple[str, ...]:
    """Names in a list, which is looked up as a split in `folder`, then as a file; none for an empty text."""
    words = [word.strip() for word in text.split(",") if word.strip()]
    if text and not words:
        raise InputError(f"--scenes {text!r} names no scene")
    names: list[str] = []
    for word in words:
        split, file = folder / f"{word}{SPLIT_SUFFIX}", Path(word)
        listed = split if split.is_file() else file if file.suffix == SPLIT_SUFFIX else None
        names += [word] if listed is None else names_in(listed)
    return tuple(dict.fromkeys(names))


def names_in(file: Path) -> list[str]:
    """The names in a file; InputError if there are none."""
    try:
        lines = [line.partition("#")[0].strip() for line in file.read_text(encoding="utf-8").splitlines()]
    except (OSError, UnicodeDecodeError) as broken:
        raise InputError(f"--scenes {file}: cannot be read: {getattr(broken, 'strerror', '') or broken}") from None
    names = [line for line in lines if line]
    if not names:
        raise InputError(f"--scenes {file}: names no scene")
    return names


def is_named(path: str, name: str) -> bool:
    """Whether a name is the end of a scene's path, with or without its suffix."""
    wanted = PurePosixPath(name).parts
    return any(one.parts[-len(wanted) :] == wanted for one in spellings(path) if wanted)


def spellings(path: str) -> tuple[PurePosixPath, ...]:
    """A scene's path, also without its suffix if that is one of scene files."""
    whole = PurePosixPath(Path(path).as_posix())
    return (whole, whole.with_suffix("")) if whole.suffix.lower() in MESH_SUFFIXES else (whole,)


def with_name(paths: Sequence[str], name: str) -> set[str]:
    """Paths that match a name."""
    shared = os.path.commonpath([os.path.dirname(os.path.abspath(path)) for path in paths])
    exact = PurePosixPath(Path(shared, name).as_posix())
    below = {path for path in paths if exact in spellings(os.path.abspath(path))}
    return below or {path for path in paths if is_named(path, name)}


def named_paths(paths: Sequence[str], names: Sequence[str]) -> set[str]:
    """Paths that match any of the names; InputError for a name without a match."""
    chosen: set[str] = set()
    for name in names:
        meant = with_name(paths, name)
        if not meant:
            known = sorted({Path(path).stem for path in paths})
            raise InputError(f"--scenes: no scene is named {name!r}{did_you_mean(name, known) or there_are(known)}")
        chosen |= meant
    return chosen


def there_are(names: Sequence[str]) -> str:
    """End of a message: the first names and the number of further ones."""
    return f"; there are {first_of(names, SHOWN)}"


def of_scenes(samples: Sequence[Sample], text: str, folder: Path) -> list[Sample]:
    """Samples in the named scenes, in their order; all if none is named."""
    names = named_scenes(text, folder)
    chosen = named_paths(list(dict.fromkeys(sample.scene for sample in samples)), names)
    return [one for one in samples if not names or one.scene in chosen]
