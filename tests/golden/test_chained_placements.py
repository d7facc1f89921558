"""Placements in a row: what was placed before drops again with the next thing, and the scene keeps all of them."""

import json
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from dcap.scene.types.particles import GRAVITY
from flows.cli.app import main

RESIDUAL = 5e-3
"""What the certificate allows of the weight of all free bodies [-]."""


MOST_SECONDS = 1800
"""Three drops in one test: other programs may have the machine, too."""


@pytest.fixture(scope="module")
def data(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """The embedded bedroom and dining room, and the objects."""
    folder = tmp_path_factory.mktemp("chain")
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("DCAP_DATA", str(folder / "data"))
        patch.setenv("DCAP_RENDER__SIZE", "256")  # nothing here is seen in the pictures
        patch.delenv("PREFECT_API_URL", raising=False)
        assert main(["dataset", "make", "--rooms", "bedroom_01,dining_01"]) == 0
        yield folder


def placed(data: Path, scene: Path, thing: str, prompt: str, out: str, *, code: int = 0) -> dict[str, Any]:
    """placement.json of one more thing."""
    path = data / "data" / "objects" / thing
    assert main(["place", str(scene), str(path), prompt, "--out", str(data / out)]) == code
    tree = json.loads((data / out / "placement.json").read_text())
    assert isinstance(tree, dict)
    return tree


def facts_of(folder: Path) -> dict[str, Any]:
    """The things that were placed, by id."""
    tree = json.loads((folder / "scene.json").read_text())
    return {one["id"]: one for one in tree["instances"] if one["placed"]}


def force_between(tree: dict[str, Any], a: str, b: str) -> float:
    """Normal force of a pair of bodies [N]."""
    return sum(row["normal_force_n"] for row in tree["contacts"] if {row["a"], row["b"]} == {a, b})


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.timeout(MOST_SECONDS)
def test_a_ball_a_book_beside_it_and_a_cup_on_the_book(data: Path) -> None:
    """Each comes to rest, the earlier ones with it: the bed carries book and cup together, and the ball alone."""
    room = data / "data" / "rooms" / "bedroom_01"
    first = placed(data, room, "ball.glb", "put the ball at the center of the bed", "one")
    second = placed(data, data / "one", "book.glb", "put the book on the bed next to the ball", "two")
    third = placed(data, data / "two", "cup.glb", "put the cup on the book", "three")
    assert [tree["verdict"] for tree in (first, second, third)] == ["at_rest"] * 3
    assert [tree["base"]["label"] for tree in (first, second, third)] == ["bed", "bed", "book"]
    things = facts_of(data / "three")
    assert [(one["id"], one["label"]) for one in things.values()] == [
        ("placed_1", "ball"), ("placed_2", "book"), ("placed_3", "cup"),
    ]  # fmt: skip
    mass = {name: one["placed"]["mass"] for name, one in things.items()}
    assert mass["placed_1"] == first["mass"]
    assert things["placed_3"]["placed"]["carried_by"] == ["placed_2"]
    bed = first["base"]["id"]
    bound = RESIDUAL * GRAVITY * sum(mass.values())
    carried = force_between(third, "placed_2", bed), force_between(third, "placed_1", bed)
    assert carried[0] == pytest.approx(GRAVITY * (mass["placed_2"] + mass["placed_3"]), abs=bound)
    assert carried[1] == pytest.approx(GRAVITY * mass["placed_1"], abs=bound)
    assert third["certificate"]["free_weight_n"] == pytest.approx(GRAVITY * sum(mass.values()), rel=1e-6)
    # the book gives way under the cup; the ball is where it was: both sink in anew from above, to a millimetre
    before, after = facts_of(data / "two"), things
    for name in ("placed_1", "placed_2"):
        moved = np.subtract(after[name]["box"]["center"], before[name]["box"]["center"])
        assert np.abs(moved).max() < 2e-3, (name, moved)
    nodes = set(trimesh.load_scene(data / "three" / "scene.glb").graph.nodes)
    assert {"placed_1", "placed_2", "object", bed} <= nodes


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.timeout(MOST_SECONDS)
def test_a_mug_on_a_book_on_a_table(data: Path) -> None:
    """On something rigid too; what cannot be placed leaves the scene as it was, and the next goes on from there."""
    room = data / "data" / "rooms" / "dining_01"
    placed(data, room, "book.glb", "put the book on the dining table", "book")
    tree = placed(data, data / "book", "mug.glb", "put the mug on the book", "mug")
    assert (tree["verdict"], tree["base"]["id"], tree["part"]) == ("at_rest", "placed_1", "body")
    assert force_between(tree, "object", "placed_1") == pytest.approx(GRAVITY * tree["mass"], rel=0.02)
    none = placed(data, data / "mug", "wardrobe.glb", "put the wardrobe on the mug", "none", code=3)
    assert none["reason"] == "too_large_for_target"
    assert not (data / "none" / "object.ply").exists()
    assert list(facts_of(data / "none")) == ["placed_1", "placed_2"]
    more = placed(data, data / "none", "apple.obj", "put the apple on the dining table next to the book", "apple")
    assert more["verdict"] == "at_rest"
    assert list(facts_of(data / "apple")) == ["placed_1", "placed_2", "placed_3"]
