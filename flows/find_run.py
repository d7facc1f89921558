"""Finds the folder of a run and reads its request, without importing anything heavy."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from pydantic import BaseModel, ValidationError

from dcap.scene.errors import InputError
from dcap.scene.readers.files import read_json
from dcap.scene.settings import runs_root
from dcap.scene.text import first_mistake, shortened

RUN = "run.json"
"""File with the request of a run."""
ASKED_VERSION = 2
"""Version of `run.json` and `sample.json`; raised when files of earlier versions can no longer be read."""
DAMAGED = "the file is damaged, or of another version of dcap; run it again"
SHOWN = 200
"""Most characters of a file's error that are shown."""


class RequestKeys(BaseModel):
    """The keys of `run.json` and `sample.json` with the types of their values."""

    dataset: str = ""
    started: str = ""
    versions: dict[str, str] = {}
    methods: list[str] = []
    config: dict[str, Any] = {}
    language: dict[str, Any] = {}
    samples: list[dict[str, Any]] = []
    sample: dict[str, Any] = {}


class EarlierRunError(InputError):
    """A run was made by an earlier version of dcap, and this one cannot use its results."""


def find_run(run: str) -> Path:
    """Return the folder of a run by name, path or `last`; InputError where there is none, or another version
    of dcap wrote it."""
    for folder in (runs_root() / run, Path(run)):
        if (folder / RUN).is_file():
            read_request(folder / RUN)
            return folder.resolve()
    known = sorted(path.parent.name for path in runs_root().glob(f"*/{RUN}"))
    raise InputError(f"{run!r} is not a run; there are {', '.join(known) or 'none'} in {runs_root()}")


def read_request(path: Path) -> dict[str, Any]:
    """Read a `run.json` or `sample.json`; InputError where it is damaged or another version of dcap wrote it."""
    tree = read_keys(path)
    version = tree.get("version", 0)
    if version != ASKED_VERSION:
        kind = EarlierRunError if isinstance(version, int) and version < ASKED_VERSION else InputError
        raise kind(f"{path}: another version of dcap made this; run it again")
    try:
        RequestKeys.model_validate(tree)
    except ValidationError as error:
        raise InputError(f"{path}: {first_mistake(error)}; {DAMAGED}") from None
    return tree


def read_keys(path: Path) -> dict[str, Any]:
    """Read the keys of a file that dcap wrote; InputError where it is damaged."""
    tree = read_json(path)
    if not isinstance(tree, dict):
        raise InputError(f"{path}: {DAMAGED}")
    return tree


@contextmanager
def input_errors(path: Path) -> Iterator[None]:
    """Convert errors from a file with unexpected content into InputError."""
    try:
        yield
    except (LookupError, TypeError, ValueError, AttributeError, AssertionError) as error:
        why = f"{type(error).__name__}: {shortened(str(error), SHOWN)}"
        if isinstance(error, ValidationError):
            why = first_mistake(error)
        raise InputError(f"{path}: {DAMAGED} ({why})") from None
