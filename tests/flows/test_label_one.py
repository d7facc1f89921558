"""`dcap dataset label` as a user runs it: files that are used again, and a page that needs nothing else."""

import json
import os
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from box_rooms import bedroom

from dcap.scene.readers.labels.given import read_given_labels
from dcap.scene.types.segmentation import GivenLabels
from dcap.scene.writers.glb import Node, glb_bytes, labelled_nodes
from flows.label_one import found_things, others_of

ROOM = bedroom()


def test_every_thing_has_its_size_and_the_height_of_its_surface() -> None:
    """Above the floor; walls have no number."""
    things = {one.id: one for one in found_things(ROOM)}
    assert things["table"].surface_m == pytest.approx(0.5, abs=1e-4)
    assert things["table"].size_m == pytest.approx((0.8, 0.8, 0.5), abs=1e-6)
    assert things["floor"].surface_m == pytest.approx(0.0, abs=1e-4)
    assert things["wall"].number == 0
    assert [one.number for one in things.values()] == [1, 2, 3, 4, 0]


def test_other_guesses_are_listed() -> None:
    """The likeliest first, without the label itself and without what is hardly possible."""
    guesses = (("table", 0.6), ("desk", 0.25), ("bench", 0.14), ("stool", 0.01))
    assert others_of(replace(ROOM.instances[1], guesses=guesses)) == "desk 25%, bench 14%"


def dcap(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """The program in a process of its own: where results are kept is decided once per process."""
    command = [sys.executable, "-m", "flows.cli", *words]
    environment = os.environ | {"DCAP_DATA": str(folder / "data")}
    return subprocess.run(command, capture_output=True, text=True, env=environment, check=False)


@pytest.mark.slow
@pytest.mark.long
def test_labels_are_written_corrected_and_used(tmp_path: Path) -> None:
    """labels.json is that of `--json`; corrected, it names things of the next run; the page loads nothing."""
    scene, out = tmp_path / "room.glb", tmp_path / "labels"
    scene.write_bytes(glb_bytes([Node("scene", children=tuple(labelled_nodes(ROOM)))]))
    done = dcap(tmp_path, "dataset", "label", str(scene), "--out", str(out), "--json")
    assert done.returncode == 0, done.stderr
    tree = json.loads(done.stdout)
    assert tree == json.loads((out / "labels.json").read_text())
    page = (out / "labels.html").read_text()
    assert not re.search(r"(src|href)=\"(?!data:)", page)
    assert page.count("<article") == 4
    tree["things"][1]["label"] = "stool"
    (out / "mine.json").write_text(json.dumps(tree))
    again = dcap(
        tmp_path, "dataset", "label", str(scene), "--labels", str(out / "mine.json"), "--out", str(tmp_path / "b")
    )
    assert again.returncode == 0, again.stderr
    labels = read_given_labels(tmp_path / "b" / "labels.json")
    assert isinstance(labels, GivenLabels)
    assert [one.label for one in labels.things] == ["bed", "stool", "table lamp", "floor", "wall"]
    gone = dcap(tmp_path, "dataset", "label", str(tmp_path / "gone.glb"), "--out", str(out))
    assert (gone.returncode, gone.stderr.count("\n")) == (2, 1)
