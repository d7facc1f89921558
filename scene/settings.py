"""Where the project keeps its files."""

import os
from pathlib import Path

PROJECT_ROOT = Path(__file__).resolve().parent.parent
"""The folder that holds pyproject.toml."""


def data_root() -> Path:
    """Folder of cache, runs and generated rooms: $DCAP_DATA, else `data/` of the project."""
    return Path(os.environ.get("DCAP_DATA") or PROJECT_ROOT / "data").resolve()


def cache_root() -> Path:
    """Folder of everything that can be computed again."""
    return data_root() / "cache"


def runs_root() -> Path:
    """Folder with one sub-folder per benchmark run."""
    return data_root() / "runs"
