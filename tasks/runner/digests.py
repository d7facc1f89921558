"""Digest of the code that decides what a stage returns: everything of ours that its module reaches by import.

In: the file of a module. Out: one digest per reachable source file, and the third-party packages met on the way.
Comments, docstrings and layout do not count (the syntax tree is hashed); imports inside functions do. A data file that
reachable code names by a string (`materials.csv`, the folder `prompts`) counts with its bytes.
"""

import hashlib
import os
import sys
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from dcap.scene import settings
from tasks.runner.parsed_sources import DATA_FOLDERS, DATA_SUFFIXES, ParsedModule, forget_parsed, kept_sources, parsed

PACKAGES = frozenset({"dcap", "flows", "solver", "tasks"})
MACHINERY = frozenset(
    {
        "dcap.language.model.anthropic_api",
        "dcap.language.model.apis",
        "dcap.language.model.batch",
        "dcap.language.model.ledger",
        "dcap.language.model.openai_api",
        "dcap.language.model.reply_folder",
        "dcap.language.protocol.session",
        "dcap.packages",
        "dcap.scene.redaction",
        "dcap.scene.settings",
        "dcap.scene.store",
        "tasks.runner",
    }
)
"""Modules and packages that carry results but do not decide them."""
FACE = "dcap"
"""The package whose own `__init__` is the public face: what it offers to programs decides no result."""
CARRIED = Path(FACE, settings.CARRIED)
"""Where an installed dcap has the data files that lie at the root of a clone."""
DISTRIBUTIONS = {"PIL": "pillow", "igl": "libigl", "skimage": "scikit-image", "ruamel": "ruamel.yaml", "yaml": "PyYAML"}
"""Where the name to install differs from the name to import."""


@dataclass(frozen=True, slots=True)
class ReachedCode:
    """What a module reaches, and the state of the files in which it was found."""

    digests: dict[str, str]
    libraries: dict[str, str]
    modified_ns: dict[str, int]
    """Of each file and of the folders that they lie in: a new file changes its folder."""

    @property
    def unchanged(self) -> bool:
        """Whether nothing was written since."""
        try:
            return all(os.stat(path).st_mtime_ns == when for path, when in self.modified_ns.items())
        except OSError:
            return False


_reached: dict[tuple[Path, Path], ReachedCode] = {}


def source_digests(module_path: Path, root: Path) -> dict[str, str]:
    """Digest of every file of ours that the module reaches, itself included, by its path relative to `root`."""
    return reached_code(module_path, root).digests


def libraries(module_path: Path, root: Path) -> dict[str, str]:
    """Versions of Python and of the third-party packages that reachable code imports."""
    return reached_code(module_path, root).libraries


def reached_code(module_path: Path, root: Path = settings.PROJECT_ROOT) -> ReachedCode:
    """What a module reaches, looked for again where a file has changed: following imports takes 50 ms each time."""
    known = _reached.get((module_path, root))
    if known is not None and known.unchanged:
        return known
    modified: dict[str, int] = {}
    paths = sorted(reachable(module_path, root, modified))
    digests = {name_of(path, root): digest_of_source(path) for path in paths}
    found = ReachedCode(digests, library_versions(paths), modified)
    kept_sources(settings.cache_root()).write()
    _reached[module_path, root] = found
    return found


def forget() -> None:
    """Drop what this process has read of sources: who measures or tests looks as a new process does."""
    _reached.clear()
    forget_parsed()


def changed_sources(digests: Mapping[str, str], root: Path = settings.PROJECT_ROOT) -> Iterator[str]:
    """Files, by their paths relative to `root`, that are no longer what they were."""
    for name, digest in digests.items():
        path = next((one for folder in (root, root / CARRIED) if (one := folder / name).is_file()), None)
        if path is None or digest_of_source(path) != digest:
            yield name


def name_of(path: Path, root: Path) -> str:
    """A file's path below the root, the same for a clone and an installed dcap: their records fit each other."""
    folder = next((one for one in (root / CARRIED, root) if path.is_relative_to(one)), path.parent)
    return str(path.relative_to(folder))


def library_versions(paths: Iterable[Path]) -> dict[str, str]:
    """Versions of Python and of the third-party packages that files import."""
    names: set[str] = set()
    for path in paths:
        if path.suffix == ".py":
            names |= {name.split(".")[0] for name in parsed(path, path.stat().st_mtime_ns).imports}
    versions = {"python": f"{sys.version_info.major}.{sys.version_info.minor}"}
    for name in sorted(names - PACKAGES - sys.stdlib_module_names):
        found = installed_version(DISTRIBUTIONS.get(name, name))
        if found:
            versions[name] = found
    return versions


@cache
def installed_version(distribution: str) -> str:
    """Version of an installed package; empty if there is none of that name."""
    try:
        return version(distribution)
    except PackageNotFoundError:
        return ""


def reachable(module_path: Path, root: Path, modified_ns: dict[str, int]) -> set[Path]:
    """Files of ours that a module reaches by import, and data files that they name; when each file and its folder were
    modified is noted before it is read."""
    found: set[Path] = set()
    looked_up: set[str] = set()
    waiting = [module_path.resolve()]
    while waiting:
        path = waiting.pop()
        if path in found:
            continue
        found.add(path)
        for one in (path.parent, path):
            modified_ns.setdefault(str(one), one.stat().st_mtime_ns)
        if path.suffix == ".py":
            module = parsed(path, modified_ns[str(path)])
            waiting.extend(imported_files(module, root, looked_up))
            waiting.extend(data_files(module, path, root))
    return found


def imported_files(module: ParsedModule, root: Path, looked_up: set[str]) -> Iterator[Path]:
    """Source files behind the imports of ours, but for the modules that were `looked_up` before; importing a module
    also runs the packages above it."""
    for name in module.imports:
        words = name.split(".")
        if words[0] not in PACKAGES:
            continue
        above = [".".join(words[:n]) for n in range(1, len(words) + 1)]
        if not MACHINERY.isdisjoint(above):
            continue
        for one in above[1:] if words[0] == FACE else above:
            if one in looked_up:
                continue
            looked_up.add(one)
            stem = root.joinpath(*one.split("."))
            yield from (path for path in (stem / "__init__.py", stem.with_suffix(".py")) if path.is_file())


def data_files(module: ParsedModule, path: Path, root: Path) -> Iterator[Path]:
    """Data files that the module names, beside it or at the root; of site-packages only those that are ours."""
    carried = root / CARRIED
    for text in module.texts:
        for folder in (path.parent, carried if carried.is_dir() else root):
            found = folder / text
            if text in DATA_FOLDERS and found.is_dir():
                yield from (one for one in sorted(found.rglob("*")) if one.is_file())
            elif found.suffix in DATA_SUFFIXES and found.is_file():
                yield found.resolve()


def digest_of_source(path: Path) -> str:
    """Digest of a file: of its syntax tree without docstrings for Python, of its bytes otherwise."""
    if path.suffix == ".py":
        return parsed(path, path.stat().st_mtime_ns).digest
    return hashlib.sha256(path.read_bytes()).hexdigest()
