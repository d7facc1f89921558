"""Where the project keeps its files."""

import os
from pathlib import Path

from dcap.scene.errors import InputError

PROJECT_ROOT = Path(__file__).resolve().parents[2]
"""The folder that holds pyproject.toml."""


def data_root() -> Path:
    """Folder of cache, runs and generated rooms: $DCAP_DATA, else `data/` of the project.

    Raises InputError for a URL: artifacts are published by renaming folders, which object stores cannot do.
    """
    given = os.environ.get("DCAP_DATA", "")
    if "://" in given:
        raise InputError(f"DCAP_DATA={given} is a URL; name a folder (mount the bucket)")
    return Path(given or PROJECT_ROOT / "data").resolve()


def cache_root() -> Path:
    """Folder of everything that can be computed again."""
    return data_root() / "cache"


def replies_root() -> Path:
    """Folder of raw replies of models: they cost money, so they are not in the cache."""
    return data_root() / "replies"


def runs_root() -> Path:
    """Folder with one sub-folder per benchmark run."""
    return data_root() / "runs"
