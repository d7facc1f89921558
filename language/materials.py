"""The library of materials: one row of `materials.csv` per material, checked on reading.

In: the CSV file with SI units in its header. Out: `Material` by id. Guaranteed: every number is finite and physical,
dynamic friction does not exceed static friction, and each row names its source (`estimate` where nobody measured it
for us).
"""

import csv
import math
from collections.abc import Mapping
from functools import cache
from pathlib import Path

from scene.errors import InputError
from scene.materials import Material
from scene.settings import PROJECT_ROOT

LIBRARY = "materials.csv"
COLUMNS = (
    "id", "name", "density_kg_m3", "youngs_modulus_pa", "poisson_ratio", "static_friction", "dynamic_friction",
    "rolling_resistance_m", "class", "synonyms", "source",
)  # fmt: skip
CLASSES = ("rigid", "soft", "thin")
RANGES = {
    "density_kg_m3": (1.0, 25_000.0),
    "youngs_modulus_pa": (1.0e2, 1.0e12),
    "poisson_ratio": (0.0, 0.499),
    "static_friction": (0.0, 2.0),
    "dynamic_friction": (0.0, 2.0),
    "rolling_resistance_m": (0.0, 0.05),
}
"""Physical limits: from down to osmium, from jelly to diamond, from PTFE to rubber."""


def load_materials(path: Path | None = None) -> dict[str, Material]:
    """All materials by id, in the order of the file; the project's own library by default."""
    file = PROJECT_ROOT / LIBRARY if path is None else path
    found: dict[str, Material] = {}
    for line, row in rows(file):
        if row["id"] in found:
            raise InputError(f"{file}:{line}: material {row['id']!r} is listed twice")
        found[row["id"]] = material(row, f"{file}:{line}")
    return found


def rows(file: Path) -> list[tuple[int, dict[str, str]]]:
    """Line number and fields of each row."""
    try:
        with file.open(newline="", encoding="utf-8") as text:
            reader = csv.DictReader(text)
            if tuple(reader.fieldnames or ()) != COLUMNS:
                raise InputError(f"{file}:1: columns {reader.fieldnames}, expected {','.join(COLUMNS)}")
            return [(reader.line_num, row) for row in reader]
    except OSError as error:
        raise InputError(f"{file}: cannot be read: {error.strerror}") from error


def material(row: Mapping[str, str], where: str) -> Material:
    """One row, checked."""
    if None in row or None in row.values():
        raise InputError(f"{where}: expected {len(COLUMNS)} fields")
    values = {name: number(row[name], name, where) for name in RANGES}
    if values["dynamic_friction"] > values["static_friction"]:
        raise InputError(f"{where}: dynamic friction {values['dynamic_friction']} > static {values['static_friction']}")
    if row["class"] not in CLASSES:
        raise InputError(f"{where}: class {row['class']!r} is not one of {', '.join(CLASSES)}")
    if not row["source"]:
        raise InputError(f"{where}: no source; write 'estimate' where there is none")
    return Material(
        id=row["id"],
        density=values["density_kg_m3"],
        youngs_modulus=values["youngs_modulus_pa"],
        poisson_ratio=values["poisson_ratio"],
        static_friction=values["static_friction"],
        dynamic_friction=values["dynamic_friction"],
        rolling_resistance=values["rolling_resistance_m"],
        kind=row["class"],
        source=row["source"],
    )


def number(text: str, name: str, where: str) -> float:
    """A number within its physical range."""
    low, high = RANGES[name]
    try:
        value = float(text)
    except ValueError:
        raise InputError(f"{where}: {name} {text!r} is not a number") from None
    if not (math.isfinite(value) and low <= value <= high):
        raise InputError(f"{where}: {name} {text} is outside {low:g}..{high:g}")
    return value


@cache
def material_words() -> dict[str, str]:
    """Material id by each of its names and synonyms, lower case; the first row that claims a word has it."""
    words: dict[str, str] = {}
    for _, row in rows(PROJECT_ROOT / LIBRARY):
        for word in (row["id"].replace("_", " "), row["name"].lower(), *row["synonyms"].lower().split("|")):
            words.setdefault(word, row["id"])
    return words
