"""Labels of the meshes in a folder, from its `assets.csv` with columns file, name, category.

`file` is a mesh, relative to the folder. `name` is the word for it in sentences, `category` a kind that the lexicon
knows; either may be empty. The label made from both is read like the stem of a file name.
"""

import csv
from collections.abc import Collection
from pathlib import Path

from dcap.language.offline.lexicon import is_a, thing_of, things
from dcap.scene.errors import InputError
from dcap.scene.text import LONGEST_WORDS, did_you_mean, unfit

ASSETS = "assets.csv"
COLUMNS = ("file", "name", "category")


def asset_labels(folder: Path, meshes: Collection[Path]) -> dict[Path, str]:
    """The labels of the meshes that assets.csv in the folder names; none without such a file. InputError for a row that
    cannot be used, with its line."""
    table = folder / ASSETS
    if not table.is_file():
        return {}
    try:
        with table.open(encoding="utf-8-sig", newline="") as file:
            reader = csv.DictReader(file, skipinitialspace=True)
            head = [name.strip() for name in reader.fieldnames or ()]
            if "file" not in head or not set(head) <= set(COLUMNS):
                raise InputError(f"{table}: columns {', '.join(head) or 'none'}; expected {', '.join(COLUMNS)}")
            reader.fieldnames = head
            rows = [(reader.line_num, row) for row in reader]
    except (OSError, UnicodeDecodeError, csv.Error) as broken:
        raise InputError(f"{table}: cannot be read: {getattr(broken, 'strerror', '') or broken}") from None
    found: dict[Path, str] = {}
    known = {one.relative_to(folder).as_posix(): one for one in meshes}
    for line, row in rows:
        if None in row or None in row.values():
            raise InputError(f"{table}:{line}: expected {len(head)} cells, as in its first line")
        cells = {name: (row.get(name) or "").strip() for name in COLUMNS}
        mesh = known.get(cells["file"])
        if mesh is None:
            hint = did_you_mean(cells["file"], list(known))
            raise InputError(f"{table}:{line}: no mesh {cells['file']!r} in this folder{hint}")
        if mesh in found:
            raise InputError(f"{table}:{line}: {cells['file']} has two rows")
        for name in ("name", "category"):
            if cells[name] and (why := unfit(cells[name], LONGEST_WORDS)):
                raise InputError(f"{table}:{line}: {name} {why}")
        if cells["category"] and thing_of(cells["category"]) is None:
            hint = did_you_mean(cells["category"], list(things()))
            raise InputError(f"{table}:{line}: the lexicon does not know the category {cells['category']!r}{hint}")
        found[mesh] = label_of(cells["name"] or mesh.stem.replace("_", " "), cells["category"])
    return found


def label_of(name: str, category: str) -> str:
    """Name that the lexicon can classify: `gundam` of category figurine becomes `gundam figurine`, or the category
    alone where the lexicon would take the combined name for another kind."""
    if not category or is_kind(name, category):
        return name
    both = f"{name} {category}"
    return both if is_kind(both, category) else category


def is_kind(label: str, category: str) -> bool:
    """Whether the lexicon classifies a label as a thing of a category that it knows."""
    thing, kind = thing_of(label), thing_of(category)
    return thing is not None and kind is not None and is_a(thing.id, kind.id)
