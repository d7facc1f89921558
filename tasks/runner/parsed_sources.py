"""What one source file says to those who follow imports: its digest without docstrings, what it imports, and which
strings could name a data file. Parsed once: what a file with these bytes says is kept in the cache, under the digest
of the bytes, so that a program that finds everything cached need not build some hundred syntax trees to see that.
"""

import ast
import hashlib
import json
import sys
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from threading import Lock

from dcap.scene.json_tree import JsonObject
from dcap.scene.settings import cache_root
from dcap.scene.store.building import free_place
from dcap.scene.store.digest import is_plain_file
from dcap.scene.whole_files import write_whole

DATA_SUFFIXES = frozenset({".csv", ".yaml", ".yml", ".json", ".j2", ".txt", ".toml"})
DATA_FOLDERS = frozenset({"prompts"})
KEPT = "sources.json"
"""File in the cache."""
MOST_KEPT = 4000
"""Sources, some ten states of all of ours; beyond it only those that were asked for are kept."""
RULES = f"{sys.version_info.major}.{sys.version_info.minor} {hashlib.sha256(Path(__file__).read_bytes()).hexdigest()}"
"""What decides what a source says, besides its bytes: the version of Python, and this file as it was loaded."""
_PARSING = Lock()
"""CPython keeps one recursion depth for the syntax trees of all threads; two that build trees at once fail now and then
with "AST constructor recursion depth mismatch" (github.com/python/cpython/issues/106905)."""


@dataclass(frozen=True, slots=True)
class ParsedModule:
    """What one source file contributes."""

    digest: str
    imports: tuple[str, ...]
    """Dotted names that are imported, longest form: `solver.settle.settle` for `from solver.settle import settle`."""
    texts: tuple[str, ...]
    """String constants that could name a data file."""


class KeptSources:
    """What was parsed before by the same rules, in the file of one cache folder. A file that is none, or damaged, is
    passed over and written anew."""

    def __init__(self, path: Path) -> None:
        self.path = path
        self._found = _read(path)
        self._asked: dict[str, ParsedModule] = {}
        self._lock = Lock()
        self._written = True

    def get(self, source: str) -> ParsedModule | None:
        """What the source with this digest of bytes says, if it is known."""
        with self._lock:
            found = self._asked.get(source) or self._found.get(source)
            if found is not None:
                self._asked[source] = found
        return found

    def add(self, source: str, module: ParsedModule) -> None:
        """Remember what a source says; `write` keeps it."""
        with self._lock:
            self._asked[source] = module
            self._written = False

    def write(self) -> None:
        """Keep what is new. A disk that takes nothing costs the next program some seconds, and nothing else."""
        with self._lock:
            if self._written:
                return
            self._written, asked = True, dict(self._asked)
        known = _read(self.path) | self._found | asked  # another program may have written meanwhile
        sources = {name: [one.digest, one.imports, one.texts]
                   for name, one in (known if len(known) <= MOST_KEPT else asked).items()}  # fmt: skip
        text = json.dumps(sources, sort_keys=True)
        with suppress(OSError):
            self.path.parent.mkdir(parents=True, exist_ok=True)
            free_place(self.path)
            tree = {"rules": RULES, "check": _digest(text.encode()), "sources": text}
            write_whole(self.path, json.dumps(tree).encode())


@cache
def kept_sources(folder: Path) -> KeptSources:
    """Of a cache folder, read once per process."""
    return KeptSources(folder / KEPT)


def parsed(path: Path, modified_ns: int) -> ParsedModule:
    """What a source file says, looked at once per process and modification."""
    return _parsed(path, modified_ns, cache_root())


def forget_parsed() -> None:
    """Drop what this process knows, but for the file."""
    kept_sources.cache_clear()
    _parsed.cache_clear()


@cache
def _parsed(path: Path, modified_ns: int, folder: Path) -> ParsedModule:
    source = path.read_bytes()
    kept, name = kept_sources(folder), _digest(source)
    found = kept.get(name)
    if found is None:
        found = said_by(source, str(path))
        kept.add(name, found)
    return found


def said_by(source: bytes, path: str) -> ParsedModule:
    """What the syntax tree of a source says."""
    with _PARSING:
        try:
            tree = ast.parse(source, filename=path)
        except SystemError:  # a thread of a library, which does not know the lock, built one meanwhile
            tree = ast.parse(source, filename=path)
    without_docstrings(tree)
    digest = _digest(ast.dump(tree, annotate_fields=False).encode())
    return ParsedModule(digest, tuple(sorted(set(imports_of(tree)))), tuple(sorted(set(texts_of(tree)))))


def _digest(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()


def _read(path: Path) -> dict[str, ParsedModule]:
    if not is_plain_file(path):  # of a pipe, reading would not end
        return {}
    try:
        tree: JsonObject = json.loads(path.read_bytes())
        text = str(tree["sources"])
        if tree["rules"] != RULES or tree["check"] != _digest(text.encode()):
            return {}
        return {name: ParsedModule(digest, tuple(imports), tuple(texts))
                for name, (digest, imports, texts) in json.loads(text).items()}  # fmt: skip
    except (OSError, ValueError, KeyError, TypeError, AttributeError, RecursionError):
        return {}


def without_docstrings(tree: ast.AST) -> None:
    """Drop every string that stands alone: docstrings of modules, classes, functions and fields."""
    for node in ast.walk(tree):
        body = getattr(node, "body", None)
        if isinstance(body, list):
            node.body = [one for one in body if not is_text_statement(one)]  # type: ignore[attr-defined]


def is_text_statement(node: ast.AST) -> bool:
    """Whether a statement is nothing but a string."""
    return isinstance(node, ast.Expr) and isinstance(node.value, ast.Constant) and isinstance(node.value.value, str)


def imports_of(tree: ast.AST) -> Iterator[str]:
    """Dotted names of all absolute imports (relative ones are not used in this project)."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            yield from (one.name for one in node.names)
        elif isinstance(node, ast.ImportFrom) and node.module:
            yield from (f"{node.module}.{one.name}" for one in node.names)


def texts_of(tree: ast.AST) -> Iterator[str]:
    """String constants that look like a file or folder name."""
    for node in ast.walk(tree):
        if isinstance(node, ast.Constant) and isinstance(node.value, str) and 0 < len(node.value) < 100:
            text = node.value
            if text in DATA_FOLDERS or (Path(text).suffix in DATA_SUFFIXES and "\n" not in text and "\0" not in text):
                yield text
