"""Locations of the project's files."""

import os
import tomllib
from importlib.metadata import version as installed_version
from importlib.resources import files
from pathlib import Path

from platformdirs import user_data_path

from dcap.packages import ROOT
from dcap.scene.errors import InputError
from dcap.scene.secrets import redacted_url

PROJECT_ROOT = ROOT
"""The folder that contains our packages: the clone with its pyproject.toml, or site-packages."""
CARRIED = "_resources"
"""Folder inside the installed `dcap` with the files from the root of a clone (setup.py puts them there)."""


def in_clone() -> bool:
    """Return whether this program runs from a clone, installed as editable or not at all."""
    return (PROJECT_ROOT / "pyproject.toml").is_file()


def resource(name: str) -> Path:
    """A file or folder at the root of a clone, or in `dcap/_resources` of a wheel: materials.csv, prompts, ..."""
    return PROJECT_ROOT / name if in_clone() else Path(str(files("dcap") / CARRIED / name))


def version() -> str:
    """Version of this dcap: of the clone from which it runs, which may not be installed, else of the installed
    package."""
    if not in_clone():
        return installed_version("dcap")
    return str(tomllib.loads((PROJECT_ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["version"])


def data_root() -> Path:
    """Folder of cache, runs and generated rooms: $DCAP_DATA, else `data/` of a clone, or the user's data folder.

    Raises InputError for a file or a URL: artifacts are published by renaming folders, which object stores cannot do.
    """
    given = os.environ.get("DCAP_DATA", "")
    if "://" in given:
        raise InputError(
            f"DCAP_DATA={redacted_url(given)} is a URL; name a folder, and set DCAP_STORE to the URL to share"
        )
    if given and os.path.isfile(given):
        raise InputError(f"DCAP_DATA={given} is a file; name a folder")
    if given:
        return Path(given).resolve()
    return home() / "data" if in_clone() else home()


def home() -> Path:
    """Folder of the user's own files for all runs: the clone, or the user's data folder."""
    return PROJECT_ROOT if in_clone() else user_data_path("dcap", appauthor=False).resolve()


def shared_store_url() -> str:
    """URL of the store in which machines share results: $DCAP_STORE, any URL that fsspec opens; empty if there is
    none."""
    return os.environ.get("DCAP_STORE", "").strip()


def cache_root() -> Path:
    """Folder of everything that can be recomputed."""
    return data_root() / "cache"


def server_folder() -> Path:
    """Folder of the database, log and locks of this data folder's Prefect server; it may be on a separate disk."""
    return cache_root() / "prefect"


def replies_root() -> Path:
    """Folder of raw replies of models: they cost money, so they are not in the cache."""
    return data_root() / "replies"


def runs_root() -> Path:
    """Folder with one sub-folder per benchmark run."""
    return data_root() / "runs"
