"""Where the project keeps its files."""

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
"""The folder that our packages lie in: the clone with its pyproject.toml, or site-packages."""
CARRIED = "_resources"
"""Folder inside the installed `dcap` with what lies at the root of a clone (setup.py puts it there)."""


def in_clone() -> bool:
    """Whether this program runs from a clone, installed as editable or not at all."""
    return (PROJECT_ROOT / "pyproject.toml").is_file()


def resource(name: str) -> Path:
    """A file or folder that a clone has at its root and a wheel in `dcap/_resources`: materials.csv, prompts, ..."""
    return PROJECT_ROOT / name if in_clone() else Path(str(files("dcap") / CARRIED / name))


def version() -> str:
    """Version of this dcap: of the clone it runs from, which may not be installed, else of the installed one."""
    if not in_clone():
        return installed_version("dcap")
    return str(tomllib.loads((PROJECT_ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["version"])


def data_root() -> Path:
    """Folder of cache, runs and generated rooms: $DCAP_DATA, else `data/` of a clone, or the user's data folder.

    Raises InputError for a file, and for a URL: artifacts are published by renaming folders, as object stores cannot.
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
    """Folder of what a person gave or keeps for all runs: the clone, or the user's data folder."""
    return PROJECT_ROOT if in_clone() else user_data_path("dcap", appauthor=False).resolve()


def shared_store_url() -> str:
    """Where machines share what they have computed: $DCAP_STORE, any URL that fsspec opens; empty if they do not."""
    return os.environ.get("DCAP_STORE", "").strip()


def cache_root() -> Path:
    """Folder of everything that can be computed again."""
    return data_root() / "cache"


def server_folder() -> Path:
    """Where the Prefect server of this data folder keeps its database, log and locks; it may be a disk of its own."""
    return cache_root() / "prefect"


def replies_root() -> Path:
    """Folder of raw replies of models: they cost money, so they are not in the cache."""
    return data_root() / "replies"


def runs_root() -> Path:
    """Folder with one sub-folder per benchmark run."""
    return data_root() / "runs"
