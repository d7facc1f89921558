"""Datasets are read strictly: whoever mistypes a key is told so."""

import json
from dataclasses import asdict
from pathlib import Path

import pytest

from dcap.scene.errors import InputError
from dcap.scene.types.sample import GivenPlace, KnownHeight, Sample
from flows.run_files import sample_from_json
from flows.samples import load_samples, samples_of


def written(folder: Path, text: str) -> Path:
    """A dataset file."""
    path = folder / "set.yaml"
    path.write_text(text)
    return path


def test_names_and_paths_are_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A room or object is looked up beside the file, then in rooms/ and objects/ of the data folder."""
    monkeypatch.setenv("DCAP_DATA", str(tmp_path / "data"))
    (tmp_path / "data" / "rooms" / "bedroom_01").mkdir(parents=True)
    (tmp_path / "data" / "objects").mkdir()
    (tmp_path / "data" / "objects" / "ball.glb").touch()
    (tmp_path / "mug.obj").touch()
    text = "- {id: a, room: bedroom_01, object: ball, prompt: put it, seed: 3, mass: 2.0e-1}\n"
    text += "- {id: b, scene: bedroom_01, object: mug.obj, prompt: put it, object_unit: mm, label: bed}\n"
    first, second = load_samples(written(tmp_path, text))
    assert first.scene == str(tmp_path / "data" / "rooms" / "bedroom_01")
    assert first.object == str(tmp_path / "data" / "objects" / "ball.glb")
    assert (first.seed, first.mass) == (3, 0.2)
    assert second.object == str(tmp_path / "mug.obj")
    assert second.object_options.unit == "mm"
    assert second.scene_options.label == "bed"


MISTAKES = [
    ("- {id: a, room: r, object: o, promt: x}", "unknown key 'promt'; did you mean 'prompt'"),
    ("- {id: a, room: r, prompt: x}", "key 'object' is missing"),
    ("- {id: a, object: o, prompt: x}", "either 'room' or 'scene'"),
    ("- {id: a, room: r, object: o, prompt: x, mass: heavy}", "mass is 'heavy'"),
    ("- {id: a, room: r, object: o, prompt: x}\n- {id: a, room: r, object: o, prompt: x}", "two samples"),
    (
        "- {id: a b, room: r, object: o, prompt: x}\n- {id: a_b, room: r, object: o, prompt: x}",
        "share the folder a_b",
    ),
    ("- {id: .., room: r, object: o, prompt: x}", "id '..' cannot name a folder"),
    (
        "- {id: Mug, room: r, object: o, prompt: x}\n- {id: mug, room: r, object: o, prompt: x}",
        "'Mug' and 'mug' would share the folder mug where case does not count",
    ),
    (f"- {{id: {'a' * 1001}, room: r, object: o, prompt: x}}", "id has 1001 characters, at most 1000 are allowed"),
    ('- {id: "a\\nb", room: r, object: o, prompt: x}', "id has the control character .*n' at place 2"),
    ('- {id: "a\\0b", room: r, object: o, prompt: x}', "id has the control character .*x00' at place 2"),
    (f"- {{id: a, room: r, object: o, prompt: {'x' * 10001}}}", "prompt has 10001 characters"),
    ('- {id: a, room: r, object: o, prompt: "put \\e[2J"}', "prompt has the control character .*x1b'"),
    ('- {id: a, room: r, object: o, prompt: "\\ud800"}', "prompt is not valid UTF-8"),
    (f"- {{id: a, room: r, object: o, prompt: x, label: {'t' * 1001}}}", "label has 1001 characters"),
    ("- {id: paper/a, room: r, object: o, prompt: x}", "id 'paper/a' begins with the name of a method"),
    ("- {id: dcap/a, room: r, object: o, prompt: x}", "id 'dcap/a' begins with the name of a method"),
    ("- {id: '', room: r, object: o, prompt: x}", "id is '', expected text"),
    ("- {id: a, room: r, object: o, prompt: x, mass: -1}", "mass is -1"),
    ("- {id: a, room: r, object: o, prompt: x, mass: .nan}", "mass is nan"),
    ("- {id: a, room: r, object: o, prompt: x, seed: 1.7}", "seed is 1.7"),
    ("- {id: a, room: r, object: o, prompt: x, seed: -1}", "seed is -1"),
    ("- {id: a, room: r, object: o, prompt: x, seed: true}", "seed is True"),
    ("- {id: a, room: r, object: o, prompt: x, up: x}", "up 'x' is not one of auto, y, z"),
    ("- {id: a, room: r, object: o, prompt: x, object_unit: ft}", "object_unit 'ft' is not one of auto, m, cm"),
    ("- {id: a, room: r, object: o, prompt: x, label: null}", "label is None, expected text"),
    ("- {id: a, room: null, object: o, prompt: x}", "room is None, expected text"),
    ("- {id: a, room: r, object: [o], prompt: x}", r"object is \['o'\], expected text"),
    ("- {id: a, room: r, object: o, prompt: ' '}", "prompt is ' ', expected text"),
    (f"- {{id: 0x{'f' * 4000}, room: r, object: o, prompt: x}}", "id is <int that is too long to write>"),
    ("a: b", "expected a list of samples, found .*"),
    ("[]", "expected a list of samples, found none"),
    ("", "expected a list of samples, found none"),
    ("[1, 2", "cannot be read as YAML"),
]
"""Texts of datasets, and what is said of each: a regular expression."""


def test_mistakes_are_named(tmp_path: Path, subtests: pytest.Subtests) -> None:
    """A wrong dataset is an error that says where and what."""
    for text, message in MISTAKES:
        with subtests.test(text), pytest.raises(InputError, match=message):
            load_samples(written(tmp_path, text))


def test_text_that_is_a_tree_of_shared_parts_is_refused(tmp_path: Path) -> None:
    """Written out it would have 9^40 words: it is named, cut short."""
    levels = [f"    - &a{k} [{', '.join([f'*a{k - 1}'] * 9)}]" for k in range(1, 41)]
    text = "\n".join(["- id:", "    - &a0 lol", *levels, "  room: r", "  object: o", "  prompt: x"])
    with pytest.raises(InputError, match=r"id is .*expected text"):
        load_samples(written(tmp_path, text))


def test_merges_without_end_are_refused(tmp_path: Path) -> None:
    """Mappings that merge each other nine times on each of forty levels; a single merge is read."""
    levels = [f"l{k}: &l{k} {{<<: [{', '.join([f'*l{k - 1}'] * 9)}]}}" for k in range(1, 41)]
    with pytest.raises(InputError, match=r"read as YAML: line 6, column \d+: merging makes \d+ keys"):
        load_samples(written(tmp_path, "\n".join(["l0: &l0 {a: 1}", *levels])))
    rows = "- &a {id: a, room: r, object: o, prompt: x}\n- {<<: *a, id: b}\n"
    assert [(one.id, one.prompt) for one in load_samples(written(tmp_path, rows))] == [("a", "x"), ("b", "x")]


def test_a_missing_dataset_is_named(tmp_path: Path) -> None:
    """A dataset file that is not there is an error with its path."""
    with pytest.raises(InputError, match=r"nothing\.yaml: no such file"):
        load_samples(tmp_path / "nothing.yaml")


def test_a_sample_may_say_more_than_a_sentence(tmp_path: Path) -> None:
    """Labels beside the dataset, a point or a box as a list or a text, a known height; mistakes name the sample."""
    (tmp_path / "labels.json").write_text("{}")
    plain = {"id": "a", "scene": "room.glb", "object": "ball.glb", "prompt": "put it there"}
    told: list[str] = []

    def read(**more: object) -> list[Sample]:
        rows = [plain | more]
        return [one for _, one in samples_of(rows, tmp_path, lambda problem: told.append(problem.what))]

    assert read(labels="labels.json")[0].labels == str(tmp_path / "labels.json")
    assert read(at=[1, 2.5])[0].place == read(at="1,2.5")[0].place == GivenPlace(at=(1.0, 2.5))
    assert read(support=[0, 0, 0, 1, 1, 1])[0].place == GivenPlace(support=(0, 0, 0, 1, 1, 1))
    assert read(height_of="table=0.75")[0].known_height == KnownHeight("table", 0.75)
    assert told == []
    assert read(at=[1]) == []
    assert told == ["sample 0: --at '1' is not 2 or 3 finite numbers between commas, for example 1.2,0.4,0.75"]


def test_a_sample_with_a_place_is_repeated() -> None:
    """run.json gives back the sample that it was written from."""
    sample = Sample("a", "s", "o", "p", place=GivenPlace(at=(1.0, 2.0)), known_height=KnownHeight("table", 0.7))
    assert sample_from_json(json.loads(json.dumps(asdict(sample)))) == sample
