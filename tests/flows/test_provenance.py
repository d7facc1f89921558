"""A result is walked back to what a person gave, whatever has happened to the cache and the code since."""

import hashlib
import json
import shutil
from dataclasses import asdict
from pathlib import Path
from typing import Any

import pytest
from known_records import known_code, known_result

from dcap.scene.types.sample import Sample
from dcap.scene.written_files import object_to_json
from flows.cli.app import main
from flows.find_run import ASKED_VERSION
from flows.place import PlaceConfig
from flows.provenance import Lineage, provenance_lines, provenance_of
from tasks.artifact import Ref, Store
from tasks.cache import deciding
from tasks.code import code_of

ROOT = Path(__file__).resolve().parents[2]
KNOWN = "tasks/records.py"
SAMPLE = Sample("one", "room.obj", "ball.obj", "put it there", seed=4)


@pytest.fixture
def chain(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> dict[str, Ref[Any]]:
    """A file that two stages read, whose results a third joins; its code is partly today's."""
    monkeypatch.setenv("DCAP_DATA", str(tmp_path / "data"))
    monkeypatch.chdir(tmp_path)
    (tmp_path / "room.obj").write_text("v 0 0 0\n")
    source = Store.default().add_source(tmp_path / "room.obj")
    today = code_of(ROOT / KNOWN).files[KNOWN]
    config = deciding(PlaceConfig().drop.model_dump(mode="json"))
    scene = known_result("mesh_scene", 1.0, {"source": source})
    intent = known_result("intent", 2.0, {"scene": scene, "prompt": SAMPLE.prompt})
    drop = known_result(
        "drop", 3.0, {"scene": scene, "intent": intent, "seed": SAMPLE.seed}, config=config | {"topple_angle": 0.5},
        code=known_code({KNOWN: today, "tasks/gone.py": "0" * 64}),
    )  # fmt: skip
    return {"source": source, "scene": scene, "intent": intent, "drop": drop}


def sample_folder_of(run: Path, refs: dict[str, Ref[Any]]) -> Path:
    """A run with one sample, as a benchmark leaves it."""
    folder = run / "samples" / "one"
    folder.mkdir(parents=True)
    (run / "run.json").write_text(json.dumps({"version": ASKED_VERSION, "samples": [asdict(SAMPLE)]}))
    rows = [{"stage": stage, "key": "", **ref.to_json()} for stage, ref in refs.items() if stage != "source"]
    (folder / "records.json").write_text(json.dumps({"version": 1, "records": rows, "inputs": []}))
    (folder / "object.ply").write_text("ply")
    return folder


def stages_of_steps(found: Lineage) -> list[str | None]:
    """Stages in the order in which they are told."""
    return [one.stage for one in found.steps.values()]


def test_a_digest_goes_back_to_the_file(chain: dict[str, Ref[Any]]) -> None:
    """Settings that are no defaults, seed, sentence, source files that changed, and the hash of what was given."""
    found = provenance_of(chain["drop"].sha256[:10])
    assert sorted(map(str, stages_of_steps(found))) == ["None", "drop", "intent", "mesh_scene"]
    drop = found.steps[chain["drop"].sha256]
    assert (drop.values, drop.changed_settings) == ({"seed": 4}, {"topple_angle": 0.5})
    assert (drop.code_files, drop.code_changed) == (2, ("tasks/gone.py",))
    assert drop.inputs == {"scene": chain["scene"].sha256, "intent": chain["intent"].sha256}
    assert found.steps[chain["intent"].sha256].values == {"prompt": "put it there"}
    (file,) = found.steps[chain["source"].sha256].files
    assert (file.name, file.sha256) == ("room.obj", hashlib.sha256(b"v 0 0 0\n").hexdigest())


def test_what_is_shared_is_told_once(chain: dict[str, Ref[Any]]) -> None:
    """The scene is an input of the drop and of the intent: the second time it is named only."""
    lines = provenance_lines(provenance_of(str(Store.default().folder(chain["drop"]))))
    assert sum("by mesh_scene" in line for line in lines) == 1
    assert sum("(see above)" in line for line in lines) == 1
    assert any("code" in line and "2 files, 1 different now" in line for line in lines)


def test_a_file_of_a_sample_leads_to_all_its_stages(chain: dict[str, Ref[Any]], tmp_path: Path) -> None:
    """By the names in its records.json; roots are what nothing else of it is made of."""
    run = tmp_path / "data" / "runs" / "first"
    folder = sample_folder_of(run, chain)
    ledger = {"settles": "x", "sample": "one", "question": "intent", "model": "m", "how": "asked", "input_tokens": 1,
              "output_tokens": 1, "cache_write_tokens": 0, "cache_read_tokens": 0, "usd": 0.1}  # fmt: skip
    other = ledger | {"sample": "two"}
    lines = [json.dumps(one) for one in (ledger | {"digest": "ab" * 32}, other)]
    (run / "usage.jsonl").write_text("\n".join(lines) + "\n")
    for given in (str(folder / "object.ply"), str(folder), "first/samples/one"):
        found = provenance_of(given)
        assert found.roots == (chain["drop"].sha256,)
        assert found.sample is not None
        assert found.sample["prompt"] == SAMPLE.prompt
        assert [(one.question, one.digest, one.reply) for one in found.asked] == [("intent", "ab" * 32, None)]
    assert json.loads(json.dumps(object_to_json(found)))["steps"][chain["drop"].sha256]["stage"] == "drop"


def test_a_lost_ancestor_does_not_end_the_way(chain: dict[str, Ref[Any]]) -> None:
    """Missing and damaged are told of the artifact; what is behind it is told all the same."""
    store = Store.default()
    shutil.rmtree(store.folder(chain["scene"]))
    (store.folder(chain["intent"]) / "value.json").write_text("{}")
    found = provenance_of(chain["drop"].sha256)
    states = {name: found.steps[ref.sha256].state for name, ref in chain.items()}
    assert states == {"source": "sound", "scene": "missing", "intent": "damaged", "drop": "sound"}
    shutil.rmtree(store.root.parent / "records")
    found = provenance_of(chain["drop"].sha256)
    assert stages_of_steps(found) == [None]
    assert any("no record tells" in line for line in provenance_lines(found))


def test_what_leads_nowhere_is_one_line(chain: dict[str, Ref[Any]], capsys: pytest.CaptureFixture[str]) -> None:
    """Exit 2, and what was given."""
    Path("damaged").mkdir()
    Path("damaged/records.json").write_text('{"records": [{"stage": 1}]}')
    for given in ("nothing here", "0123456789", "room.obj", "a" * 5000, "damaged"):
        assert main(["provenance", given]) == 2, given
        said = capsys.readouterr().err
        assert said.count("\n") == 1
        assert given[:20] in said
