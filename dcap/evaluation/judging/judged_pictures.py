"""Pictures for a judge, read from a run's folder on demand.

In: `clean.png` (the scene before), `asset.png` (the object alone) and the views of a placement, PNG. Out: names and
makers of pictures for a question.
"""

from collections.abc import Sequence
from pathlib import Path

from dcap.language.protocol.requests import Picture
from dcap.scene.errors import InputError
from dcap.scene.readers.files import read_image

BEFORE_TITLES = ("the scene before the object is placed", "the object alone")
"""Captions for a judge of the pictures that all methods of a sample share."""


def pictures_in(folder: Path, names: Sequence[str]) -> tuple[Picture, ...]:
    """`NAME.png` of a folder of views for each name; InputError for a missing one."""
    if not names:
        raise InputError(f"{folder}: no view is named; a judge needs at least one")
    return tuple(picture_at(folder / f"{name}.png", name) for name in names)


def picture_at(path: Path, name: str) -> Picture:
    """A picture that is read on demand; InputError at once if there is none."""
    if not path.is_file():
        raise InputError(f"{path}: no such picture; a judge needs the run's views")
    return Picture(name, lambda: read_image(path.read_bytes(), str(path)))
