"""A folder of exported files, written whole or not at all.

`export.json` lists the written files. A new export removes those of an earlier one; other files in the folder stay.
"""

import json
import os
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path, PurePosixPath

from dcap.scene.errors import InputError
from dcap.scene.json_tree import draft_folder
from flows.output import readable_json
from flows.scene_splats import SETTLED_SPLATS

Files = Mapping[str, bytes]
"""Content by path within the folder."""

FOLDER, LIST = "export", "export.json"
SPLATS = "splats"
"""The settled Gaussians, one file without a list."""


def write_files(folder: Path, files: Files, kind: str) -> None:
    """Write files into a folder: into a draft there, then one by one, the list last; InputError where it cannot be."""
    listed = {**files, LIST: readable_json({"format": kind, "files": sorted(files)})}
    try:
        folder.mkdir(parents=True, exist_ok=True)
        check_free(folder, listed)
        with draft_folder(folder) as draft:
            for name, content in listed.items():
                path = draft / name
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_bytes(content)
            clear_export(folder)
            for name in listed:
                (folder / name).parent.mkdir(parents=True, exist_ok=True)
                os.replace(draft / name, folder / name)
    except OSError as error:
        where = error.filename or folder
        raise InputError(f"{folder}: {where}: {error.strerror or error}; give another folder (--out)") from None


def check_free(folder: Path, files: Files) -> None:
    """Raise InputError if a folder is in the way of a file, or a file in the way of a folder."""
    for name in files:
        if (folder / name).is_dir():
            raise InputError(f"{folder / name} is a folder where a file goes; move it or give another folder (--out)")
        for parent in list((folder / name).parents)[: len(PurePosixPath(name).parts) - 1]:
            if parent.exists() and not parent.is_dir():
                raise InputError(f"{parent} is a file where a folder goes; move it or give another folder (--out)")


def clear_export(folder: Path) -> None:
    """Remove the files of an earlier export, and their folders if nothing else is in them."""
    try:
        names = list(json.loads((folder / LIST).read_bytes())["files"])
    except (OSError, ValueError, KeyError, TypeError):
        return  # none, or none of ours
    paths = [PurePosixPath(one) for one in names if isinstance(one, str)]
    within = [path for path in paths if path.parts and not path.is_absolute() and ".." not in path.parts]
    for path in within:
        with suppress(OSError):
            (folder / path).unlink(missing_ok=True)
    (folder / LIST).unlink(missing_ok=True)
    for parent in sorted({path.parent for path in within if len(path.parts) > 1}, reverse=True):
        with suppress(OSError):
            (folder / parent).rmdir()


def clear_exports(out: Path) -> None:
    """Remove the exports of an earlier placement in the same folder."""
    folders = [path for path in (out / FOLDER).glob("*") if path.is_dir()]
    for folder in folders:
        clear_export(folder)
        if folder.name == SPLATS:
            (folder / SETTLED_SPLATS).unlink(missing_ok=True)
    for folder in (*folders, out / FOLDER):
        with suppress(OSError):  # not there, or something else is in it
            folder.rmdir()
