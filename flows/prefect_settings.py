"""Settings of Prefect for our programs: the project's, the environment's, and none of the working directory.

Prefect itself also reads `.env`, `prefect.toml` and `pyproject.toml` from wherever a program starts. Such a file may
come with a data set, and what it names may be run: a file for Python's logging calls any function.
"""

import os
import sys
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from importlib.machinery import ModuleSpec, PathFinder, SourceFileLoader
from importlib.util import find_spec, spec_from_file_location
from types import ModuleType
from typing import Any

from dcap.scene.settings import resource, server_folder

SOURCES = "prefect.settings.sources"
"""The module of Prefect that reads files of settings."""
READERS = {"FilteredDotEnvSettingsSource": "_read_env_files", "TomlConfigSettingsSourceBase": "_read_files"}
"""Its classes that read such files, and by which method."""
LOGGING_FILE = ("PREFECT_LOGGING_CONFIG_PATH", "PREFECT_LOGGING_SETTINGS_PATH")
"""Prefect's names for the same setting."""


class OwnSourcesLoader(SourceFileLoader):
    """Loads Prefect's module and lets it read no file of the working directory."""

    def exec_module(self, module: ModuleType) -> None:
        """Run the module, then replace what reads such files."""
        super().exec_module(module)
        for source, reads in READERS.items():
            if not hasattr(getattr(module, source, None), reads):
                raise ImportError(f"{self.name} has no {source}.{reads}: this version of Prefect reads files otherwise")
            setattr(getattr(module, source), reads, no_settings)


class OwnSourcesFinder:
    """Finds that module and nothing else: `import prefect` reads settings before anyone could replace something."""

    @staticmethod
    def find_spec(name: str, path: Sequence[str] | None = None, target: ModuleType | None = None) -> ModuleSpec | None:
        """Where an import comes from, None for whatever else it is."""
        found = PathFinder.find_spec(name, path) if name == SOURCES else None
        if found is None or found.origin is None:
            return None
        return spec_from_file_location(name, found.origin, loader=OwnSourcesLoader(name, found.origin))


def of_prefect(*place: str) -> str:
    """A file that comes with Prefect."""
    found = find_spec("prefect")
    if found is None or found.origin is None:
        raise ImportError("prefect is not installed", name="prefect")
    return os.path.join(os.path.dirname(found.origin), *place)


def no_settings(*_: object) -> Mapping[str, Any]:
    """What a file says that is not read."""
    return {}


def apply_settings() -> None:
    """Put the project's prefect.toml into the environment, wherever the program was started. Whoever has imported
    Prefect before has chosen its settings."""
    tree = tomllib.loads(resource("prefect.toml").read_text(encoding="utf-8"))
    for name, value in flattened(tree, "PREFECT"):
        os.environ.setdefault(name, value)
    os.environ.setdefault("DO_NOT_TRACK", "1")
    # the environment is asked first, also in processes that others start here: those of a cluster
    chosen = os.environ.get("PREFECT_HOME")
    os.environ.setdefault("PREFECT_HOME", str(server_folder()))
    # none of the data folder, which a data set may choose
    profiles = os.path.join(chosen, "profiles.toml") if chosen else of_prefect("settings", "profiles.toml")
    os.environ.setdefault("PREFECT_PROFILES_PATH", profiles)
    if not any(name in os.environ for name in LOGGING_FILE):
        os.environ[LOGGING_FILE[0]] = of_prefect("logging", "logging.yml")
    # runs report to the server; the terminal belongs to our own lines
    os.environ.setdefault("PREFECT_LOGGING_HANDLERS_CONSOLE_LEVEL", "CRITICAL")
    os.environ.setdefault("PREFECT_INTERNAL_LOGGING_LEVEL", "CRITICAL")
    if OwnSourcesFinder not in sys.meta_path:
        sys.meta_path.insert(0, OwnSourcesFinder)


def flattened(tree: dict[str, object], prefix: str) -> Iterator[tuple[str, str]]:
    """`[server] analytics_enabled = false` as PREFECT_SERVER_ANALYTICS_ENABLED=false."""
    for key, value in tree.items():
        name = f"{prefix}_{key.upper()}"
        if isinstance(value, dict):
            yield from flattened(value, name)
        else:
            yield name, str(value).lower() if isinstance(value, bool) else str(value)
