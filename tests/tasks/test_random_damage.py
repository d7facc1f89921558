"""Whatever disks, people and killed programs do to the cache: never a wrong result, never a traceback, all healed."""

import os
import random
from pathlib import Path
from typing import Any

import pytest
from small_stages import CHAIN, chain, ends_of

from tasks import artifact, code, records
from tasks.artifact import Ref, Store
from tasks.code import PARSED, changed_sources, code_of
from tasks.run_context import Event, Mode
from tasks.upkeep import damages, repair

SEEDS = range(3)
"""Of the chains: each is a file of its own in a pipeline."""


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A cache with the results of some chains of stages."""
    monkeypatch.setenv("DCAP_DATA", str(tmp_path))
    return tmp_path / "cache"


def as_a_new_program() -> None:
    """Forget which artifacts and records this process has read."""
    artifact._default_store.cache_clear()
    records._read_once.cache_clear()
    code._sources_at_begin.cache_clear()


def strike(cache: Path, chance: random.Random) -> str:
    """Truncate, flip, lengthen or delete a file, at random; half of the time its modification time stays as it was."""
    roots = (cache / "records", cache / "store" / "objects")
    records, all_files = ([path for path in sorted(root.rglob("*")) if path.is_file()] for root in roots)
    path = chance.choice(chance.choice([records, all_files, [cache / PARSED]]))
    kind = chance.choice(("truncate", "flip", "lengthen", "delete", "empty"))
    if not path.is_file():
        return "nothing"
    before, data = path.stat(), bytearray(path.read_bytes())
    if kind == "truncate":
        del data[chance.randrange(max(len(data), 1)) :]
    elif kind == "flip":
        for _ in range(chance.choice((1, 1, 20)) if data else 0):
            data[chance.randrange(len(data))] ^= 1 << chance.randrange(8)
    elif kind == "lengthen":
        data += chance.randbytes(9)
    elif kind == "empty":
        data.clear()
    path.unlink()
    if kind != "delete":
        path.write_bytes(data)
        if chance.random() < 0.5:
            os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns))
    return f"{kind} {path.relative_to(cache)}"


def contents(refs: list[Ref[Any]]) -> dict[Ref[Any], dict[str, bytes]]:
    """Names and bytes of the files of artifacts."""
    return {ref: {path.name: path.read_bytes() for path in Store.default().folder(ref).iterdir()} for ref in refs}


def check(cache: Path, count: int) -> None:
    """Damage by damage: what is returned is what was returned before any, and what is loaded are its bytes."""
    chance, source = random.Random(count), Path(__file__)
    truth = [chain(seed) for seed in SEEDS]
    undisturbed, known = [contents(refs) for refs in truth], code_of.__wrapped__(source)
    for _ in range(count):
        done = strike(cache, chance)
        as_a_new_program()
        found = [chain(seed) for seed in SEEDS]
        assert found == truth, done
        for ref in (ref for refs in found for ref in refs):
            Store.default().load(ref)
        assert code_of.__wrapped__(source) == known, done
    assert [contents(refs) for refs in truth] == undisturbed
    assert list(changed_sources(known.files)) == []
    repair(damages())
    assert damages() == []
    for seed, refs in zip(SEEDS, truth, strict=True):
        assert ends_of(lambda seed=seed: chain(seed), mode=Mode.LOOKUP) == (refs, dict.fromkeys(CHAIN, Event.CACHED))


def test_thirty_damages(cache: Path) -> None:
    """After each all results are as before, and a repair leaves nothing damaged and nothing to compute."""
    check(cache, 30)


@pytest.mark.slow
@pytest.mark.long
def test_three_hundred_damages(cache: Path) -> None:
    """The same for longer."""
    check(cache, 300)
