"""Why a stage would run is told by what a person can change: a value, a file, a setting, code, a library."""

from pathlib import Path

import pytest
from written_records import CODE, deciders, ref_of, write_record

from dcap.scene.store.artifacts import Store
from tasks.runner.record_index import record_index
from tasks.runner.records import Deciders
from tasks.runner.why import in_words, why_not_cached

SCAN, SCENE, WISH = ref_of("Scan", "1"), ref_of("Segmentation", "2"), ref_of("Intent", "3")


@pytest.fixture(autouse=True)
def data(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A cache of each test's own."""
    monkeypatch.setenv("DCAP_DATA", str(tmp_path))
    return tmp_path


def told(wanted: Deciders) -> str:
    """The reason in a line."""
    return in_words(why_not_cached(wanted, Store.default()))


def test_what_was_never_computed() -> None:
    """Without any record of the stage there is nothing to compare with."""
    assert told(deciders("intent", {"prompt": "put it"})) == "never computed"


def test_a_lost_artifact() -> None:
    """The same deciders have a record: what is missing is the artifact."""
    write_record(deciders("intent", {"prompt": "put it"}), WISH)
    assert told(deciders("intent", {"prompt": "put it"})) == "artifact missing or damaged"


def test_settings_code_and_libraries_are_named() -> None:
    """Each with its values, settings by their dotted names; what is equal is not told."""
    old = deciders("drop", {"seed": 0}, {"solver": {"cell": 0.01, "seed": 0}, "share": 0.5})
    write_record(old, ref_of("Settled", "4"))
    new = deciders("drop", {"seed": 0}, {"solver": {"cell": 0.02, "seed": 0}, "share": 0.5},
                   CODE | {"solver/step.py": "b" * 64}, {"numpy": "2.4.0"})  # fmt: skip
    assert told(new) == (
        "code changed: solver/step.py; settings changed: drop.solver.cell (0.01 -> 0.02); numpy 2.3.0 -> 2.4.0"
    )


def test_the_first_of_many_are_named() -> None:
    """A line stays a line: three files by name, the others by their number."""
    write_record(deciders("drop", {}), ref_of("Settled", "4"))
    files = {f"solver/{name}.py": "b" * 64 for name in "abcde"}
    assert told(deciders("drop", {}, code=CODE | files)) == (
        "code changed: solver/a.py, solver/b.py, solver/c.py and 2 more"
    )


def test_an_input_is_followed_to_the_stage_that_changed() -> None:
    """Materials would run for another anchor, which is another because the intent is, because the sentence is."""
    other, wish, place = ref_of("Intent", "5"), ref_of("Anchor", "6"), ref_of("Anchor", "7")
    write_record(deciders("intent", {"scene": SCENE, "prompt": "on the bed"}), WISH)
    write_record(deciders("intent", {"scene": SCENE, "prompt": "on the desk"}), other)
    write_record(deciders("anchor", {"scene": SCENE, "intent": WISH}), wish)
    write_record(deciders("anchor", {"scene": SCENE, "intent": other}), place)
    write_record(deciders("materials", {"scene": SCENE, "anchor": wish}), ref_of("PartMaterials", "8"))
    assert told(deciders("materials", {"scene": SCENE, "anchor": place})) == (
        "input anchor <- intent: prompt changed (on the bed -> on the desk)"
    )


def test_one_reason_is_told_once() -> None:
    """The sentence reaches a stage by itself and through the intent: it has changed once."""
    other = ref_of("Intent", "5")
    write_record(deciders("intent", {"prompt": "on the bed"}), WISH)
    write_record(deciders("intent", {"prompt": "on the desk"}), other)
    write_record(deciders("anchor", {"intent": WISH, "prompt": "on the bed"}), ref_of("Anchor", "6"))
    assert told(deciders("anchor", {"intent": other, "prompt": "on the desk"})) == (
        "prompt changed (on the bed -> on the desk)"
    )


def test_the_closest_record_is_that_of_the_same_sample() -> None:
    """A record with the same sentence counts before a newer one whose scene is the same."""
    write_record(deciders("intent", {"scene": SCENE, "prompt": "on the bed"}), WISH)
    write_record(deciders("intent", {"scene": ref_of("Segmentation", "9"), "prompt": "on the desk"}), WISH)
    segmented = deciders("segment", {"scan": SCAN}, {"gap": 0.1})
    write_record(segmented, SCENE)
    again = ref_of("Segmentation", "a")
    write_record(deciders("segment", {"scan": SCAN}, {"gap": 0.2}), again)
    assert told(deciders("intent", {"scene": again, "prompt": "on the bed"})) == (
        "input scene: settings changed: segment.gap (0.1 -> 0.2)"
    )


def test_a_file_that_was_given_is_named(tmp_path: Path) -> None:
    """Behind a source there is no stage, but the file of a person."""
    (tmp_path / "ball.obj").write_text("v 0 0 0\n")
    old = Store.default().add_source(tmp_path / "ball.obj")
    (tmp_path / "ball.obj").write_text("v 0 0 1\n")
    new = Store.default().add_source(tmp_path / "ball.obj")
    write_record(deciders("mesh_object", {"source": old}), SCAN)
    assert told(deciders("mesh_object", {"source": new})) == "input source: new or changed file ball.obj"


def test_what_is_given_otherwise_is_named_where_both_a_value_and_a_file_are(tmp_path: Path) -> None:
    """By what it is now: whether the record with another sentence and another file is an earlier one of this sample
    cannot be told."""
    (tmp_path / "ball.obj").write_text("v 0 0 0\n")
    old = Store.default().add_source(tmp_path / "ball.obj")
    write_record(deciders("mesh_object", {"options": {"unit": "m"}, "source": old}), SCAN)
    (tmp_path / "ball.obj").write_text("v 0 0 1\n")
    new = Store.default().add_source(tmp_path / "ball.obj")
    assert told(deciders("mesh_object", {"options": {"unit": "mm"}, "source": new}, {"weld": 2})) == (
        'no earlier result with options {"unit": "mm"}, file ball.obj'
    )


def test_a_record_of_another_sample_is_no_reason(tmp_path: Path) -> None:
    """Neither its sentence nor its file was ever this sample's: what this one had is no longer there."""
    for name, letter in (("ball", "4"), ("bear", "5")):
        (tmp_path / f"{name}.obj").write_text(f"# {name}\n")
        source = Store.default().add_source(tmp_path / f"{name}.obj")
        write_record(deciders("mesh_object", {"source": source}), ref_of("Scan", letter))
    write_record(deciders("intent", {"item": ref_of("Scan", "5"), "prompt": "the bear on the bed"}), WISH)
    ball = {"item": ref_of("Scan", "4"), "prompt": "the ball on the bed"}
    assert told(deciders("intent", ball)) == "no earlier result with prompt the ball on the bed, file ball.obj"
    bear = {"item": ref_of("Scan", "5"), "prompt": "the bear on the desk"}
    assert told(deciders("intent", bear)) == "prompt changed (the bear on the bed -> the bear on the desk)"


def test_records_that_come_later_are_seen() -> None:
    """What one process computes after it has looked counts when it looks again."""
    assert record_index().of_stage("intent") == []
    first = write_record(deciders("intent", {"prompt": "a"}), WISH)
    assert record_index().of_stage("intent") == [first]
    assert record_index().making(WISH) == [first]
    write_record(deciders("intent", {"prompt": "b"}), WISH)
    assert len(record_index().making(WISH)) == 2


def test_the_files_of_a_folder_that_changed_are_named(tmp_path: Path) -> None:
    """Those that are other, gone or new; what is the same is not."""
    (room := tmp_path / "room").mkdir()
    (room / "mesh.ply").write_text("mesh")
    (room / "labels.json").write_text("[1]")
    (room / "info.txt").write_text("old")
    store = Store.default()
    write_record(deciders("mesh", {"source": store.add_source(str(room))}), SCAN)
    (room / "labels.json").write_text("[2]")
    (room / "info.txt").unlink()
    wanted = deciders("mesh", {"source": store.add_source(str(room))})
    assert told(wanted) == "input source: new or changed file info.txt, labels.json in the folder"
