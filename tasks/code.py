"""Our own sources that decide a stage's result: every file that its module reaches by static import.

Comments, docstrings and layout do not count (the syntax tree is hashed); imports inside functions do. A data file that
reachable code names by a string (`materials.csv`, the folder `prompts`) counts with its bytes. The digest and the
imports of a source file are kept in the cache: building 650 syntax trees takes three seconds.

A program hashes the sources of its stages once, soon after its start, and its fork server hashes the sources that it
has loaded (preload.py): both run the code loaded then, even if it is edited later. Data files are read when a stage
runs, so they are checked again before its result is kept.
"""

import ast
import hashlib
import json
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from threading import Lock
from typing import Any

from dcap.packages import LOADED_NS
from dcap.scene import settings
from dcap.scene.errors import StoreError
from dcap.scene.written_files import canonical_json, write_whole

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
        "dcap.scene.secrets",
        "dcap.scene.settings",
        "tasks.artifact",
        "tasks.cache",
        "tasks.code",
        "tasks.codec",
        "tasks.records",
        "tasks.process",
        "tasks.run_context",
        "tasks.shared_store",
    }
)
"""Modules whose changes never invalidate a cached result."""
FACE = "dcap"
"""The package whose own `__init__` is the public interface, which decides no result."""
DATA_SUFFIXES = frozenset({".csv", ".yaml", ".yml", ".json", ".j2", ".txt", ".toml"})
DATA_FOLDERS = frozenset({"prompts"})
LONGEST_NAME = 100
"""Maximum length of a string that may name a data file [characters]."""
CARRIED = Path(FACE, settings.CARRIED)
"""Folder of an installed dcap with the data files of a clone's root."""
DISTRIBUTIONS = {
    "PIL": "pillow", "igl": "libigl", "pxr": "usd-core", "ruamel": "ruamel.yaml", "skimage": "scikit-image",
    "yaml": "PyYAML",
}  # fmt: skip
"""Packages that are installed under another name than they are imported."""
PARSED, LISTS = "sources.json", "code"
"""File of the cache with parsed sources, and its folder with lists of files, named by their digest."""
RULES = f"{sys.version_info[:2]} {hashlib.sha256(Path(__file__).read_bytes()).hexdigest()}"
"""All that decides the parse of a source besides its bytes."""
MOST_TRIES = 10
"""Number of attempts to parse a source: threads disturb each other in CPython's parser (cpython issue 106905)."""
_known_lists: dict[str, Mapping[str, str]] = {}
"""Lists of files of this process's code, by digest."""
_lock = Lock()
"""Lets only one of our threads build trees at a time, for the same reason."""


@dataclass(frozen=True, slots=True)
class Code:
    """The sources behind a stage."""

    digest: str
    """SHA-256 over all of `files`."""
    files: Mapping[str, str]
    """Digest by path relative to the root, the same for a clone and an installed dcap."""
    libraries: Mapping[str, str]
    """Versions of Python and of the third-party packages that these files import."""


@cache
def code_of(module_path: Path, root: Path = settings.PROJECT_ROOT) -> Code:
    """Return the sources that a module reaches, including itself; determined once per process, which runs the loaded
    code."""
    with _lock:
        parsed = _sources_at_begin(settings.cache_root() / PARSED)
        paths = sorted(_reachable(module_path.resolve(), root, parsed))
        files = {_name_of(path, root): _digest_of(path, parsed) for path in paths}
        imported = {name.split(".")[0] for path in paths if path.suffix == ".py" for name in parsed[path]["imports"]}
        parsed.write()
    code = Code(hashlib.sha256(canonical_json(files)).hexdigest(), files, _versions(imported))
    _known_lists[code.digest] = files
    return code


@cache
def code_at_begin(modules: tuple[Path, ...]) -> None:
    """Hash the sources that some modules reach; raises StoreError if one was edited after this program began to load,
    because the loaded state is then unknown."""
    now = time.time_ns()
    for module in modules:
        for name in code_of(module).files:
            path = _path_of(name, settings.PROJECT_ROOT)
            if path is not None and LOADED_NS < path.stat().st_mtime_ns <= now:
                raise StoreError(f"{name} has changed while this program started; start it again")


def check_data_files(code: Code, root: Path = settings.PROJECT_ROOT) -> None:
    """Raise StoreError if a data file has changed since it was hashed, because the state that a stage has read is then
    unknown."""
    for name, digest in code.files.items():
        if not name.endswith(".py"):
            path = _path_of(name, root)
            if path is None or hashlib.sha256(path.read_bytes()).hexdigest() != digest:
                raise StoreError(f"{name} has changed while this program runs; start it again")


def note_files(code: Code) -> None:
    """Store the list of files behind a result, so that a later difference of keys can be explained."""
    path = settings.cache_root() / LISTS / f"{code.digest}.json"
    with suppress(OSError):
        if not path.is_file():
            path.parent.mkdir(parents=True, exist_ok=True)
            write_whole(path, canonical_json(code.files))


def files_behind(digest: str) -> Mapping[str, str] | None:
    """Return the files of a state of the code, by their paths; None if it was not stored here."""
    if digest in _known_lists:
        return _known_lists[digest]
    try:
        data = (settings.cache_root() / LISTS / f"{digest}.json").read_bytes()
    except OSError:
        return None
    return dict(json.loads(data)) if hashlib.sha256(data).hexdigest() == digest else None


def changed_sources(files: Mapping[str, str], root: Path = settings.PROJECT_ROOT) -> Iterator[str]:
    """Yield the changed files, by their paths relative to `root`."""
    parsed = _ParsedSources(settings.cache_root() / PARSED)
    for name, digest in files.items():
        path = _path_of(name, root)
        with _lock:
            if path is None or _digest_of(path, parsed) != digest:
                yield name


class _ParsedSources:
    """Parsed sources by their paths, in one file of the cache; a damaged file counts as empty."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._known: dict[str, Any] = {}
        self._read: dict[Path, dict[str, Any]] = {}
        self._changed = False
        with suppress(OSError, ValueError, KeyError, TypeError):
            tree = json.loads(path.read_bytes())
            if tree["check"] == self._check(tree["sources"]):
                self._known = tree["sources"]

    def __getitem__(self, path: Path) -> dict[str, Any]:
        if path not in self._read:
            source = path.read_bytes()
            digest = hashlib.sha256(source).hexdigest()
            said = self._known.get(str(path), {})
            if said.get("bytes") != digest:
                said = {"bytes": digest, **_parse(source, path)}
                self._changed = True
            self._read[path] = self._known[str(path)] = said
        return self._read[path]

    def write(self) -> None:
        """Store new entries for the next program, and drop those of deleted files."""
        if self._changed:
            self._changed = False
            self._known = {name: said for name, said in self._known.items() if Path(name).is_file()}
            with suppress(OSError):  # costs the next program some seconds
                self.path.parent.mkdir(parents=True, exist_ok=True)
                write_whole(self.path, canonical_json({"check": self._check(self._known), "sources": self._known}))

    @staticmethod
    def _check(sources: Mapping[str, Any]) -> str:
        return hashlib.sha256(RULES.encode() + canonical_json(sources)).hexdigest()


_sources_at_begin = cache(_ParsedSources)


def _parse(source: bytes, path: Path) -> dict[str, Any]:
    """Return the digest of a source without docstrings, its imports, and the names of files in it."""
    tree = _tree_of(source, path)
    imports, texts = set[str](), set[str]()
    for node in ast.walk(tree):
        if isinstance(getattr(node, "body", None), list):
            node.body = [one for one in node.body if not _is_docstring(one)]  # type: ignore[attr-defined]
        if isinstance(node, ast.Import):
            imports |= {one.name for one in node.names}
        elif isinstance(node, ast.ImportFrom) and node.module:  # relative imports are not used in this project
            imports |= {f"{node.module}.{one.name}" for one in node.names}
        elif isinstance(node, ast.Constant) and isinstance(node.value, str) and _may_name_data(node.value):
            texts.add(node.value)
    digest = hashlib.sha256(ast.dump(tree, annotate_fields=False).encode()).hexdigest()
    return {"digest": digest, "imports": sorted(imports), "texts": sorted(texts)}


def _tree_of(source: bytes, path: Path) -> ast.Module:
    """Return the syntax tree; retries if another thread, such as one of Prefect's, has disturbed the parser."""
    for _ in range(MOST_TRIES - 1):
        with suppress(SystemError):
            return ast.parse(source, filename=str(path))
    return ast.parse(source, filename=str(path))


def _is_docstring(node: ast.AST) -> bool:
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)


def _may_name_data(text: str) -> bool:
    plain = 0 < len(text) < LONGEST_NAME and "\n" not in text and "\0" not in text
    return plain and (text in DATA_FOLDERS or Path(text).suffix in DATA_SUFFIXES)


def _reachable(module_path: Path, root: Path, parsed: _ParsedSources) -> set[Path]:
    """Return our files that a module reaches by import, and the data files that they name."""
    found: set[Path] = set()
    waiting = [module_path]
    while waiting:
        path = waiting.pop()
        if path not in found:
            found.add(path)
            if path.suffix == ".py":
                waiting += _imported_files(parsed[path]["imports"], root)
                waiting += _data_files(parsed[path]["texts"], path, root)
    return found


def _imported_files(imports: list[str], root: Path) -> Iterator[Path]:
    """Yield the source files behind imports; importing a module also runs the packages above it."""
    for name in imports:
        words = name.split(".")
        above = [".".join(words[:count]) for count in range(1, len(words) + 1)]
        if words[0] in PACKAGES and MACHINERY.isdisjoint(above):
            for one in above[1:] if words[0] == FACE else above:
                yield from _module_files(one, root)


@cache
def _module_files(module: str, root: Path) -> tuple[Path, ...]:
    stem = root.joinpath(*module.split("."))
    return tuple(path for path in (stem / "__init__.py", stem.with_suffix(".py")) if path.is_file())


def _data_files(texts: list[str], path: Path, root: Path) -> Iterator[Path]:
    """Yield the data files that a module names, next to it or at the root; from site-packages only our own."""
    carried = root / CARRIED
    for text in texts:
        for folder in (path.parent, carried if carried.is_dir() else root):
            found = folder / text
            if text in DATA_FOLDERS and found.is_dir():
                yield from (one for one in found.rglob("*") if one.is_file())
            elif found.suffix in DATA_SUFFIXES and found.is_file():
                yield found.resolve()


def _path_of(name: str, root: Path) -> Path | None:
    return next((one for folder in (root / CARRIED, root) if (one := folder / name).is_file()), None)


def _name_of(path: Path, root: Path) -> str:
    folder = next((one for one in (root / CARRIED, root) if path.is_relative_to(one)), path.parent)
    return path.relative_to(folder).as_posix()


def _digest_of(path: Path, parsed: _ParsedSources) -> str:
    return str(parsed[path]["digest"]) if path.suffix == ".py" else hashlib.sha256(path.read_bytes()).hexdigest()


def _versions(imported: set[str]) -> dict[str, str]:
    found = {"python": f"{sys.version_info.major}.{sys.version_info.minor}"}
    for name in sorted(imported - PACKAGES - sys.stdlib_module_names):
        if known := installed_version(DISTRIBUTIONS.get(name, name)):
            found[name] = known
    return found


@cache
def installed_version(distribution: str) -> str:
    """Return the version of an installed package; empty if it is not installed."""
    try:
        return version(distribution)
    except PackageNotFoundError:
        return ""
