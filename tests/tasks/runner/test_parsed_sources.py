"""What a source says is kept under the digest of its bytes, and found again unless what was kept is damaged."""

import ast
import hashlib
import json
import os
from collections.abc import Iterator
from pathlib import Path

import pytest

from dcap.scene.settings import cache_root
from tasks.runner.digests import forget
from tasks.runner.parsed_sources import KEPT, MOST_KEPT, RULES, ParsedModule, kept_sources, parsed, said_by

SOURCE = '"""Doc."""\nfrom dcap.scene import box\nTABLE = "materials.csv"\n'


@pytest.fixture
def source(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """A file, and a cache of its own."""
    monkeypatch.setenv("DCAP_DATA", str(tmp_path / "data"))
    path = tmp_path / "one.py"
    path.write_text(SOURCE)
    yield path
    forget()


def said(path: Path) -> ParsedModule:
    """What it says, kept for the next process."""
    found = parsed(path, path.stat().st_mtime_ns)
    kept_sources(cache_root()).write()
    return found


def test_a_source_is_parsed_once_for_all_programs(source: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Until its bytes change; a comment changes them, and not what they say."""
    first = said(source)
    assert first.imports == ("dcap.scene.box",)
    assert first.texts == ("materials.csv",)
    forget()
    with monkeypatch.context() as patch:
        patch.setattr(ast, "parse", lambda *_, **__: pytest.fail("parsed again"))
        assert said(source) == first
    source.write_text(SOURCE + "# more\n")
    forget()
    assert said(source) == first
    source.write_text(SOURCE + "more = 1\n")
    assert said(source).digest != first.digest


@pytest.mark.parametrize("damage", ["flip", "cut", "none", "words", "folder", "pipe", "loop", "other rules", "gone"])
def test_what_is_damaged_is_passed_over(source: Path, damage: str) -> None:
    """It decides keys of results, so not a byte of it may be wrong; it is written anew."""
    first = said(source)
    kept = cache_root() / KEPT
    data = kept.read_bytes()
    kept.unlink()
    if damage == "flip":
        kept.write_bytes(data.replace(first.digest.encode(), first.digest[::-1].encode()))
    elif damage == "cut":
        kept.write_bytes(data[:-20])
    elif damage == "none":
        kept.write_bytes(b"")
    elif damage == "words":
        kept.write_text(json.dumps(["sources"]))
    elif damage == "folder":
        kept.mkdir()
    elif damage == "pipe":
        os.mkfifo(kept)
    elif damage == "loop":
        kept.symlink_to(kept.name)
    elif damage == "other rules":
        text = json.loads(data)["sources"].replace(first.digest, first.digest[::-1])
        check = hashlib.sha256(text.encode()).hexdigest()
        kept.write_text(json.dumps({"rules": "3.9 other", "check": check, "sources": text}))
    forget()
    assert said(source) == first
    assert kept.read_bytes() == data


def test_it_does_not_grow_without_end(source: Path) -> None:
    """Beyond so many only what was asked for stays."""
    keeper = kept_sources(cache_root())
    for number in range(MOST_KEPT + 1):
        keeper._found[f"{number:064d}"] = ParsedModule("0", (), ())
    first = said(source)
    tree = json.loads((cache_root() / KEPT).read_bytes())
    assert tree["rules"] == RULES
    assert [one[0] for one in json.loads(tree["sources"]).values()] == [first.digest]


def test_what_is_kept_is_what_is_said(source: Path) -> None:
    """Kept or parsed, the same."""
    first = said(source)
    forget()
    assert said(source) == said_by(source.read_bytes(), str(source)) == first
