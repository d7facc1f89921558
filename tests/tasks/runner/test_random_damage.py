"""No damage to the cache gives a wrong result or trips anybody: it is healed on use, or told in a line."""

import shutil
from collections import Counter
from collections.abc import Callable, Iterator
from functools import cache
from pathlib import Path
from typing import Any

import pytest
from PIL import Image
from random_damage import Vandal
from textured import quarters
from torn import fine_box

from dcap.scene.store.artifacts import Store
from dcap.scene.store.earlier_files import copy_earlier, lost_notes, note_files
from dcap.scene.store.ref import Ref
from dcap.scene.types.sample import SourceOptions
from tasks.mesh.stage import mesh_object_task
from tasks.mesh.surfaces import surface_object_task
from tasks.runner import digests
from tasks.runner.context import NotCachedError, RunContext, use_context
from tasks.runner.damage import DamagedThing, damages, repair
from tasks.runner.records import Record, records_root, usable_key, write_record
from tasks.runner.stage import Stage
from tasks.segment.stage import segment_object_task

WIDTHS = (0.1, 0.2, 0.3)
AT_ONCE = 4
"""Damages between two runs."""
Call = Callable[..., Ref[Any]]
SUFFIXES = {".json", ".mtl", ".obj", ".parquet", ".ply", ".png"}
"""Of the files of their artifacts: of each way to keep a value there is one."""
MODULES = {
    "tasks/one.py": "from dcap.two import TABLE\n",
    "dcap/two.py": 'TABLE = "table.csv"\n',
    "dcap/table.csv": "1,2\n",
}
"""Sources of ours, but few."""
KEYS = ("one", "two", "three")
NOTED = {"scene": "scene.glb", "script": "deep/one.js"}
"""Files that were made before, by what they are."""


@pytest.fixture
def meshes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> list[Path]:
    """Three boxes with a texture as OBJ, and a data folder."""
    monkeypatch.setenv("DCAP_DATA", str(tmp_path / "data"))
    for name in ("source_digests", "libraries"):  # our code does not change meanwhile
        monkeypatch.setattr(f"tasks.runner.stage.{name}", cache(getattr(digests, name)))
    Image.fromarray(quarters()).save(tmp_path / "quarters.png")
    (tmp_path / "box.mtl").write_text("newmtl painted\nmap_Kd quarters.png\n")
    paths = [tmp_path / f"box_{width}.obj" for width in WIDTHS]
    for path, width in zip(paths, WIDTHS, strict=True):
        path.write_text(box_obj(width))
    return paths


def box_obj(width: float) -> str:
    """A box of faces enough for its numbers to be kept in tables."""
    mesh = fine_box((0.0, 0.0, 0.0), (width, 0.1, 0.1), rounds=2)
    lines = ["mtllib box.mtl", "usemtl painted"]
    lines += [f"v {x} {y} {z}\nvt {x / width} {y / 0.1}" for x, y, z in mesh.vertices.tolist()]
    return "\n".join(lines + [f"f {a}/{a} {b}/{b} {c}/{c}" for a, b, c in (mesh.faces + 1).tolist()])


@pytest.fixture
def beside(tmp_path: Path) -> Path:
    """A folder with sources of ours and files that were made before."""
    for name, text in (MODULES | {f"made/{name}": name for name in NOTED.values()}).items():
        path = tmp_path / "beside" / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    return tmp_path / "beside"


def sources(beside: Path) -> dict[str, str]:
    """What decides a stage, as a new program finds it."""
    digests.forget()
    return digests.source_digests(beside / "tasks" / "one.py", beside)


def copied(beside: Path, key: str) -> dict[str, str]:
    """The files of a key that are copied from where they were made: all, or none, and whole."""
    folder = beside / "copied"
    shutil.rmtree(folder, ignore_errors=True)
    found = copy_earlier(key, folder)
    assert found in ({}, NOTED)
    assert all((folder / name).read_text() == name for name in found.values())
    return found


@pytest.fixture(scope="module")
def server(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """A Prefect server whose database lies outside of the cache that is damaged."""
    from flows.server import prefect_server

    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("DCAP_DATA", str(tmp_path_factory.mktemp("server")))
        patch.delenv("PREFECT_API_URL", raising=False)
        with prefect_server() as url:
            yield url


def chain(path: Path, call: Call) -> list[Ref[Any]]:
    """The first stages of an object, from its file on: everything that they return."""
    source: Ref[Any] = Store.default().add_source(path)
    scan = call(mesh_object_task, source, SourceOptions())
    surface = call(surface_object_task, source, scan)
    return [source, scan, surface, call(segment_object_task, scan)]


def by_prefect(stage: Stage[..., Any], *inputs: Any) -> Ref[Any]:
    """A stage as a flow calls it."""
    return stage(*inputs)


def directly(stage: Stage[..., Any], *inputs: Any) -> Ref[Any]:
    """The same without Prefect: a look for a record, else the function, then a record."""
    arguments = dict(stage.signature.bind_partial(*inputs).arguments)
    config = stage.hints["config"]() if "config" in stage.signature.parameters else None
    deciders = stage.deciders(arguments, config)
    store = Store.default()
    name, record = usable_key(deciders.key, store)
    if record is None:
        settings = None if config is None else config.model_dump(mode="json")
        values = stage.load(deciders.to_json()["inputs"], settings, RunContext().session)  # type: ignore[arg-type]
        done = stage.save(stage.function(**values), 0.1)
        record = Record(deciders.key, Ref.from_json(done["ref"]), 0.1, done["size"], deciders.to_json())
        write_record(records_root() / name, record, store)
    return record.ref


def contents(refs: list[Ref[Any]]) -> dict[Ref[Any], dict[str, bytes]]:
    """Names and bytes of all files of artifacts."""
    folders = {ref: Store.default().folder(ref) for ref in refs}
    return {
        ref: {str(path.relative_to(folder)): path.read_bytes() for path in folder.rglob("*") if path.is_file()}
        for ref, folder in folders.items()
    }


def check(meshes: list[Path], beside: Path, call: Call, count: int, seed: int) -> None:
    """Damage by damage: what is returned is what was returned before any, and what is loaded are its bytes."""
    truth, decided = [chain(path, call) for path in meshes], sources(beside)
    undisturbed = contents([ref for refs in truth for ref in refs])
    assert {Path(name).suffix for files in undisturbed.values() for name in files} == SUFFIXES
    for key in KEYS:
        note_files(key, beside / "made", NOTED)
    vandal = Vandal(records_root().parent, seed)
    for begin in range(0, count, AT_ONCE):
        names = [vandal.strike() for _ in range(min(AT_ONCE, count - begin))]
        found = [chain(path, call) for path in meshes]
        assert found == truth, names
        unsound = [ref for refs in found for ref in refs if not Store.default().is_here(ref)]
        assert unsound == [], names
        for ref in (one for refs in found for one in refs):
            Store.default().load(ref)
        assert sources(beside) == decided, names
        for key in KEYS:
            copied(beside, key)
            note_files(key, beside / "made", NOTED)
        if begin % (count // 5) == 0:
            damages(Store.default())  # tells, and does not trip
            lost_notes()
    assert sum(vandal.done.values()) == count
    assert contents([ref for refs in truth for ref in refs]) == undisturbed
    repair(damages(Store.default()))
    assert [one for one in damages(Store.default()) if one.what is not DamagedThing.LITTER] == []
    for path, refs in zip(meshes, truth, strict=True):
        with use_context(RunContext(lookup_only=True)):
            assert chain(path, by_prefect) == refs  # raises NotCachedError if a stage would run
    assert [copied(beside, key) for key in KEYS] == [NOTED] * len(KEYS)
    assert Counter(one.kind for one in Store.default().refs())["Scan"] == len(meshes)


def test_forty_damages(meshes: list[Path], beside: Path) -> None:
    """The rules of lookup and store, without Prefect around them."""
    check(meshes, beside, directly, 40, 0)


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("seed", [1, 2])
def test_a_thousand_damages_without_prefect(meshes: list[Path], beside: Path, seed: int) -> None:
    """The same for longer."""
    check(meshes, beside, directly, 1000, seed)


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.timeout(1800)
def test_a_thousand_damages(server: str, meshes: list[Path], beside: Path) -> None:
    """The same through Prefect, as a flow runs the stages."""
    check(meshes, beside, by_prefect, 1000, 7)


def test_a_stage_that_is_not_there_is_told(meshes: list[Path]) -> None:
    """The check above can fail: without a record the look says so."""
    chain(meshes[0], directly)
    shutil.rmtree(records_root())
    with use_context(RunContext(lookup_only=True)), pytest.raises(NotCachedError):
        chain(meshes[0], by_prefect)
