"""Promises of the recipes: what is written is what is made, and a mistake is told where it is."""

import re
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest

from dcap.scene.errors import InputError
from dcap.scene.readers.mesh.obj import read_obj
from dcap.scene.settings import PROJECT_ROOT
from dcap.synthetic.catalogue import THINGS
from dcap.synthetic.dataset import make_dataset
from dcap.synthetic.recipes import object_recipes, palette, room_names, room_recipe
from dcap.synthetic.rooms import board_heights, furnish

ROOM = """\
kind: Study Room
seed: 1
size: [3, 2.5, 2.5]
wall: cream
floor: {planks: {color: oak}}
doors:
  - {wall: west, along: 0.6, width: 0.8, height: 2}
things:
  - piece: {bookshelf: {timber: oak, seed: 2, boards: 4}}
    name: shelf
    against: {wall: north, along: 1.5}
  - {piece: {plant: {seed: 3}}, varies: true, stand: {x: 0, y: 0}}
  - {piece: mug, upon: {thing: shelf, right: 0.1, board: 1}}
"""
"""A sound recipe that the tests below spoil."""


def folder_with(path: Path, room: str) -> Path:
    """A folder of recipes with one room called `one`."""
    (path / "rooms").mkdir(parents=True)
    (path / "rooms" / "one.yaml").write_text(room)
    return path


def test_every_embedded_recipe_is_sound() -> None:
    """All rooms and objects are read, and every builder of things to place is some object's."""
    assert all(room_recipe(name).things for name in room_names())
    used = {recipe.piece.name for recipe in object_recipes().values()}
    assert used >= {builder.__name__ for builder in THINGS}


MISTAKES = [
    ("kind: Study", "knid: Study", 1, r"unknown key 'knid'; did you mean 'kind'\?"),
    ("kind: Study Room\n", "", 1, "key 'kind' is missing"),
    ("[3, 2.5, 2.5]", "[3, -2.5, 2.5]", 3, r"size\.1: Input should be greater than 0 \(got -2\.5\)"),
    ("wall: cream", "wall: craem", 4, r"unknown colour 'craem'; did you mean 'cream'\?"),
    ("wall: cream", "wall: [0, 0, 256]", 4, r"less than or equal to 255 \(got 256\)"),
    ("{planks: {color", "{plonks: {color", 5, r"unknown name 'plonks'; did you mean 'planks'\?"),
    ("wall: west", "wall: left", 7, r"doors\.0\.wall: Input should be 'south', 'east', 'north' or 'west'"),
    ("height: 2}", "height: 2.6}", 1, "the opening at 0.6 m does not fit into the west wall"),
    ("bookshelf: {", "bookshelv: {", 9, r"things\.0\.piece: unknown name 'bookshelv'; did you mean 'bookshelf'\?"),
    ("boards: 4", "bords: 4", 9, r"things\.0\.piece\.bookshelf: unknown key 'bords'; did you mean 'boards'\?"),
    ("timber: oak, ", "", 9, r"things\.0\.piece\.bookshelf: key 'timber' is missing"),
    ("seed: 2", "seed: two", 9, r"things\.0\.piece\.bookshelf\.seed: .* \(got 'two'\)"),
    ("seed: 3}}, varies", "seed: 3}}, at: {x: 1, y: 1}, varies", 12, "exactly one of the keys"),
    ("piece: mug,", "piece: mug, varies: true,", 13, "varies: a mug has no seed"),
    ("piece: mug,", "piece: mug, books: {seed: 1},", 13, "books: only a bookshelf has boards"),
    ("thing: shelf", "thing: shlef", 1, r"unknown thing 'shlef'; did you mean 'shelf'\?"),
    ("board: 1", "board: 4", 1, "it has 4 boards; there is no board 4"),
    ("board: 1", "board: 1, top: 1", 1, "expected top or board, not both"),
    ("piece: mug,", "piece: mug, name: shelf,", 1, "two things have the name 'shelf'"),
]  # fmt: skip
"""A text of the sound recipe, what stands there instead, the line that is named, and what is said of it."""


def test_mistakes_are_told_by_file_line_and_key(tmp_path: Path, subtests: pytest.Subtests) -> None:
    """One line names the file, the line, the key and the nearest known word."""
    for number, (sound, spoilt, line, told) in enumerate(MISTAKES):
        with subtests.test(str((sound, spoilt))):
            assert ROOM.count(sound) == 1
            folder = folder_with(tmp_path / str(number), ROOM.replace(sound, spoilt))
            with pytest.raises(InputError, match=told) as caught:
                room_recipe("one", folder)
            assert str(caught.value).startswith(f"{folder}/rooms/one.yaml:{line}: ")
            assert "\n" not in str(caught.value)


@pytest.mark.parametrize("text", ["[", "- 1\n", "", "kind: &a [*a]\n", "\x00"])
def test_what_is_no_recipe_is_refused(tmp_path: Path, text: str) -> None:
    """Broken YAML, another kind of tree, nothing at all: an input error, one line."""
    with pytest.raises(InputError) as caught:
        room_recipe("one", folder_with(tmp_path, text))
    assert "\n" not in str(caught.value)


def test_things_stand_where_the_recipe_says(tmp_path: Path) -> None:
    """Against its wall with the gap, clear of the walls, on the board."""
    room = furnish(room_recipe("one", folder_with(tmp_path, ROOM)), 0)
    shelf, plant, mug, lamp = (placed.thing for placed in room.things)
    assert shelf.bounds[1, 1] == pytest.approx(2.5 - 0.02)
    assert shelf.bounds[:, 0].mean() == pytest.approx(1.5)
    np.testing.assert_allclose(plant.bounds[0, :2], 0.02, atol=1e-12)
    assert mug.bounds[0, 2] == pytest.approx(board_heights(shelf)[1] - 0.0015)  # pressed in, so that they touch
    assert mug.bounds[:, 0].mean() < 1.5  # right of a shelf that looks to the south is west
    assert lamp.label == "ceiling lamp"


def test_a_folder_may_add_colours_to_the_embedded_ones(tmp_path: Path) -> None:
    """And replace them."""
    folder = folder_with(tmp_path, ROOM.replace("wall: cream", "wall: teal"))
    (folder / "colors.yaml").write_text("teal: [0, 128, 128]\noak: [1, 2, 3]\n")
    assert room_recipe("one", folder).wall == (0, 128, 128)
    assert palette(folder)["oak"] == (1, 2, 3)
    assert palette(folder)["pine"] == palette()["pine"]


def test_the_documented_example_is_made(tmp_path: Path) -> None:
    """The recipes of docs/formats.md give a room with everything in it, and two objects of the stated sizes."""
    section = (PROJECT_ROOT / "docs" / "formats.md").read_text("utf-8").split("## A room or an object of one's own")[1]
    for text in re.findall(r"```yaml\n(# (?:rooms/\w+|objects)\.yaml\n.*?)```", section.split("\n## ")[0], re.DOTALL):
        path = tmp_path / "recipes" / text.split()[1]
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
    out = tmp_path / "out"
    make_dataset(out, recipes=tmp_path / "recipes")
    assert (out / "rooms" / "nook" / "labels.json").is_file()
    labels = set(pq.read_table(out / "truth" / "nook.parquet")["label"].to_pylist())
    assert labels >= {
        "desk",
        "table lamp",
        "bookshelf",
        "book",
        "mug",
        "rug",
        "plant",
        "curtain",
        "ceiling lamp",
        "door",
    }
    assert {path.name for path in (out / "objects").iterdir()} == {"blue_stool.glb", "mug_in_cm.obj"}
    mug = read_obj(out / "objects" / "mug_in_cm.obj")
    assert np.ptp(mug.vertices[:, 2]) == pytest.approx(9.5, abs=0.05)  # the mug is 9.5 cm high
