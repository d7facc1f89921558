"""Reads the library of materials (`materials.csv`) and the usual thicknesses of covers (`covers.csv`).

Each row of `materials.csv` is a `Material`; the header states SI units. Every number is finite and physical, dynamic
friction does not exceed static friction, no word names two rows, and each number has a source.

`source` is `estimate`, or a list of sources with the columns that they cover (without units; `rest` means all others):

    density, youngs_modulus: https://a.page (how it was derived) | static_friction: https://b.page | rest: estimate

Each page states the number or a range that contains it; the text in brackets explains how the number follows. Soft
things of many fibres or layers have an effective modulus in compression, and the name says so. For cloth in layers and
fibre fillings the modulus applies across the layers; the `layer_` columns apply within and between them. Rows whose
constants are not positive definite together are refused.

A cover, such as a blanket, is spread over other things as a layer. Its role decides, not its material: a pillow of the
same fleece is not a cover.
"""

import csv
import math
import re
from collections.abc import Mapping, Sequence
from functools import cache
from importlib.resources import files
from pathlib import Path

from dcap.scene.errors import InputError
from dcap.scene.settings import resource
from dcap.scene.types.materials import LayerConstants, Material

LIBRARY = "materials.csv"
COLUMNS = (
    "id", "name", "density_kg_m3", "youngs_modulus_pa", "poisson_ratio", "layer_youngs_modulus_pa",
    "layer_poisson_ratio", "layer_shear_modulus_pa", "static_friction", "dynamic_friction", "rolling_resistance_m",
    "family", "class", "synonyms", "source",
)  # fmt: skip
FAMILIES = (
    "foam", "upholstery", "filling", "textile", "leather", "wood", "metal", "glass", "ceramic", "plastic", "rubber",
    "paper", "stone", "food", "other",
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
"""Physical limits: density of feathers to osmium, stiffness of jelly to diamond, friction of PTFE to rubber."""
LAYER_RANGES = {
    "layer_youngs_modulus_pa": (1.0e2, 1.0e9),
    "layer_poisson_ratio": (-0.9, 0.9),
    "layer_shear_modulus_pa": (1.0e1, 1.0e9),
}
"""Physical limits of layered materials, from loose feathers to plywood glue; a row fills all these columns or none."""


def sourced_as(column: str) -> str:
    """The name of a column in `source`: without its unit."""
    return column.removesuffix("_kg_m3").removesuffix("_pa").removesuffix("_m")


SOURCED = tuple(sourced_as(column) for column in RANGES)
LAYERS_SOURCED = tuple(sourced_as(column) for column in LAYER_RANGES)
ESTIMATE, REST = "estimate", "rest"
PAGE = re.compile(r"https?://[^\s|]+( \([^|]+\))?")


def load_materials(path: Path | None = None) -> dict[str, Material]:
    """All materials by id, in the order of the file; the project's own library by default."""
    file = resource(LIBRARY) if path is None else path
    found: dict[str, Material] = {}
    claimed: dict[str, str] = {}
    for line, row in rows(file):
        if row["id"] in found:
            raise InputError(f"{file}:{line}: material {row['id']!r} is listed twice")
        found[row["id"]] = material(row, f"{file}:{line}")
        for word in words_of(row):
            if claimed.setdefault(word, row["id"]) != row["id"]:
                raise InputError(f"{file}:{line}: {word!r} names {claimed[word]} already")
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
    """Check a row and return its material."""
    if None in row or None in row.values():
        raise InputError(f"{where}: expected {len(COLUMNS)} fields")
    values = {name: number(row[name], name, where) for name in RANGES}
    if values["dynamic_friction"] > values["static_friction"]:
        raise InputError(f"{where}: dynamic friction {values['dynamic_friction']} > static {values['static_friction']}")
    if row["class"] not in CLASSES:
        raise InputError(f"{where}: class {row['class']!r} is not one of {', '.join(CLASSES)}")
    if row["family"] not in FAMILIES:
        raise InputError(f"{where}: family {row['family']!r} is not one of {', '.join(FAMILIES)}")
    layers = layers_of(row, where)
    sources_of(row["source"], where, SOURCED if layers is None else SOURCED + LAYERS_SOURCED)
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
        layers=layers,
    )


def layers_of(row: Mapping[str, str], where: str) -> LayerConstants | None:
    """The constants of a layered material, positive definite; None if the row leaves them empty."""
    given = [name for name in LAYER_RANGES if row[name]]
    if not given:
        return None
    values = {name: number(row[name], name, where) for name in LAYER_RANGES}
    layers = LayerConstants(*values.values())
    problem = layers.problem(float(row["youngs_modulus_pa"]), float(row["poisson_ratio"]))
    if problem:
        raise InputError(f"{where}: {problem}")
    return layers


def number(text: str, name: str, where: str) -> float:
    """A number within its physical range."""
    low, high = (RANGES | LAYER_RANGES)[name]
    try:
        value = float(text)
    except ValueError:
        raise InputError(f"{where}: {name} {text!r} is not a number") from None
    if not (math.isfinite(value) and low <= value <= high):
        raise InputError(f"{where}: {name} {text} is outside {low:g}..{high:g}")
    return value


def sources_of(text: str, where: str, sourced: Sequence[str] = SOURCED) -> dict[str, str]:
    """Page or `estimate` of each column of `sourced`; each column has exactly one source."""
    if not text:
        raise InputError(f"{where}: no source; write 'estimate' where there is none")
    if text == ESTIMATE:
        return dict.fromkeys(sourced, ESTIMATE)
    found: dict[str, str] = {}
    for entry in text.split(" | "):
        columns, _, reference = entry.partition(": ")
        if reference != ESTIMATE and not PAGE.fullmatch(reference):
            raise InputError(
                f"{where}: source {entry!r} is not 'COLUMNS: URL', 'COLUMNS: URL (how)' or 'rest: estimate'"
            )
        for column in [c for c in sourced if c not in found] if columns == REST else columns.split(", "):
            if column not in sourced or column in found:
                raise InputError(f"{where}: source of {column!r}, expected each of {', '.join(sourced)} once")
            found[column] = reference
    missing = [column for column in sourced if column not in found]
    if missing:
        raise InputError(f"{where}: no source of {', '.join(missing)}; end with 'rest: estimate'")
    return found


def words_of(row: Mapping[str, str]) -> set[str]:
    """Names of a row: its id and its synonyms, lower case."""
    return {row["id"].replace("_", " "), *(word for word in row["synonyms"].lower().split("|") if word)}


@cache
def material_words() -> dict[str, str]:
    """Material id by each word or phrase that names it."""
    return {word: row["id"] for _, row in rows(resource(LIBRARY)) for word in words_of(row)}


@cache
def families() -> dict[str, str]:
    """Family of each material: wood, metal, foam ..."""
    return {row["id"]: row["family"] for _, row in rows(resource(LIBRARY))}


@cache
def cover_thicknesses() -> dict[str, float]:
    """Usual thickness of each cover [m], by each of its words."""
    with (files("dcap.knowledge") / "covers.csv").open(encoding="utf-8") as text:
        return {
            word: float(row["thickness_m"]) for row in csv.DictReader(text) for word in row["words"].split("|")
        }  # fmt: skip


def cover_thickness(name: str) -> float | None:
    """Usual thickness of a cover with this name [m]; None if it is not a cover. The last words decide: a "wool blanket"
    is a blanket, a "blanket box" is a box."""
    known, words = cover_thicknesses(), name.lower().replace("_", " ").replace("-", " ").split()
    endings = [" ".join(words[start:]) for start in range(len(words))]
    singular = [one.removesuffix("s") for one in endings]
    return next((known[one] for one in (*endings, *singular) if one in known), None)
