"""assets.csv names the meshes beside it, and a row that cannot be used is refused by its line."""

from pathlib import Path

import pytest

from dcap.scene.errors import InputError
from flows.sample_files import asset_labels, label_of


def labels(folder: Path, text: str) -> dict[str, str]:
    """The labels that a table gives to a.glb, b.glb and sub/c.obj, by file."""
    (folder / "assets.csv").write_text(text, encoding="utf-8")
    meshes = [folder / "a.glb", folder / "b.glb", folder / "sub" / "c.obj"]
    return {one.relative_to(folder).as_posix(): label for one, label in asset_labels(folder, meshes).items()}


def test_names_and_categories(tmp_path: Path) -> None:
    """Columns may stand in any order, cells may be empty; without a table nothing is named."""
    assert asset_labels(tmp_path, [tmp_path / "a.glb"]) == {}
    assert labels(tmp_path, "name,file,category\ncoffee mug,a.glb,\nGundam, b.glb, figurine\n,sub/c.obj,bowl\n") == {
        "a.glb": "coffee mug",
        "b.glb": "Gundam figurine",
        "sub/c.obj": "c bowl",
    }
    assert labels(tmp_path, "file,category\na.glb,mug\n") == {"a.glb": "a mug"}


@pytest.mark.parametrize(
    ("name", "category", "label"),
    [
        ("coffee mug", "", "coffee mug"),
        ("coffee mug", "mug", "coffee mug"),
        ("coffee mug", "cup", "coffee mug"),  # a mug is a cup
        ("Gundam", "figurine", "Gundam figurine"),
        ("teddy bear", "lamp", "lamp"),  # its longest known words would win: a lamp in the shape of a bear
    ],
)
def test_a_label_is_of_its_category(name: str, category: str, label: str) -> None:
    """A name whose kind is that of the category stays, another one gets the category, or gives way to it."""
    assert label_of(name, category) == label


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("file,kind\na.glb,mug\n", "columns file, kind; expected file, name, category"),
        ("name\nmug\n", "expected file, name, category"),
        ("file,name\na.gbl,mug\n", ":2: no mesh 'a.gbl' in this folder; did you mean 'a.glb'?"),
        ("file,name\na.glb,mug\na.glb,cup\n", ":3: a.glb has two rows"),
        ("file,name\na.glb,mug,more\n", ":2: expected 2 cells"),
        ("file,category\na.glb,mugg\n", ":2: the lexicon does not know the category 'mugg'"),
        ("file,name\na.glb,red\x07mug\n", ":2: name "),
    ],
)
def test_a_row_that_cannot_be_used(tmp_path: Path, text: str, told: str) -> None:
    """One line that names the table, the line and what is wrong."""
    with pytest.raises(InputError) as refused:
        labels(tmp_path, text)
    assert told in str(refused.value)
    assert "\n" not in str(refused.value)
