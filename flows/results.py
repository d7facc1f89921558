"""Return values of `dcap.place` and `dcap.drop`, and the JSON Schema of placement.json that follows.

In: the content of those files and the folder they lie in. Out: frozen values, nested as in the files; units and
meanings of the keys are in docs/formats.md. Objects without fixed keys (bodies, timings) are `NamedValues` mappings.

The schema is of draft 2020-12. Keys are only added within a version; what is removed, renamed or means
something else makes a new one.
"""

import json
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields
from functools import cache
from pathlib import Path
from types import GenericAlias
from typing import Any, Generic, TypeVar, get_args

from pydantic import GetCoreSchemaHandler, TypeAdapter, ValidationError
from pydantic_core import CoreSchema, core_schema

from dcap.scene.errors import InputError
from dcap.scene.types.outcome import Reason
from dcap.scene.types.settled import PlacementChecks, SettledMaterial
from dcap.scene.written_files import JsonObject, object_to_json
from flows.find_run import read_keys
from flows.placement_json import AT_REST, SCHEMA_VERSION
from solver.certificate import Certificate, ContactRow

Value = TypeVar("Value")
Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
"""(w, x, y, z)."""
Bounds = tuple[Vector, Vector]
"""[[min], [max]] in metres."""
Row = tuple[float, float, float, float]
Matrix = tuple[Row, Row, Row, Row]
"""4x4, row by row, acts on column vectors."""
OWN = ("checks", "evidence", "folder", "tree")
"""Fields of `Placement` that are not keys of the file."""


class NamedValues(Mapping[str, Value], Generic[Value]):
    """A read-only mapping whose keys are attributes too: `timings["drop"]` is `timings.drop`."""

    __slots__ = ("_items",)

    def __init__(self, items: Mapping[str, Value]) -> None:
        self._items: dict[str, Value] = {key: with_names(value) for key, value in items.items()}

    def __getitem__(self, key: str) -> Value:
        return self._items[key]

    def __iter__(self) -> Iterator[str]:
        return iter(self._items)

    def __len__(self) -> int:
        return len(self._items)

    def __getattr__(self, name: str) -> Value:
        if name.startswith("_") or name not in self._items:
            raise AttributeError(f"no {name!r} here; there is {', '.join(self._items) or 'nothing'}")
        return self._items[name]

    def __dir__(self) -> list[str]:
        return [*super().__dir__(), *self._items]

    def __repr__(self) -> str:
        return f"NamedValues({self._items!r})"

    @classmethod
    def __get_pydantic_core_schema__(cls, source: Any, handler: GetCoreSchemaHandler) -> CoreSchema:
        """Built from a plain mapping whose values are checked."""
        plain: Any = GenericAlias(dict, (str, *get_args(source)))
        return core_schema.no_info_after_validator_function(cls, handler.generate_schema(plain))


def with_names(value: Any) -> Any:
    """A value of JSON with its mappings as `NamedValues` and its lists as tuples, at any depth."""
    if isinstance(value, dict):
        return NamedValues(value)
    return tuple(with_names(one) for one in value) if isinstance(value, list) else value


@dataclass(frozen=True, slots=True)
class Base:
    """The instance that carries the object."""

    id: str
    label: str


@dataclass(frozen=True, slots=True)
class CandidateRow:
    """An instance that the prompt may mean as the support."""

    id: str
    label: str
    score: float
    """Likelihood that the prompt means it, 0..1."""


@dataclass(frozen=True, slots=True)
class Pose:
    """Of the object's own origin; for a soft object its best-fit rigid motion."""

    position: Vector
    """[m]."""
    quaternion: Quaternion


@dataclass(frozen=True, slots=True)
class MaterialRow:
    """Material and model of a simulated part."""

    body: str
    part: str
    material: str
    model: str
    """rigid or mpm."""
    reason: str
    density: float
    """[kg/m^3]."""
    youngs_modulus: float
    """[Pa]."""
    poisson_ratio: float
    static_friction: float
    dynamic_friction: float
    source: str


@dataclass(frozen=True, slots=True)
class GeometryRow:
    """How the solid of a body was made from its faces."""

    body: str
    part: str
    method: str
    closed: bool
    sides_agree: float | None
    hausdorff_m: float | None
    mean_m: float | None
    tolerance_m: float | None
    region_m: Bounds | None
    volume_m3: float | None
    repairs: tuple[str, ...]
    problem: str | None


@dataclass(frozen=True, slots=True)
class ViewRow:
    """One view of the object at rest."""

    azimuth_deg: float
    """Off the base's front."""
    elevation_deg: float
    visible_fraction: float
    """Of the silhouette."""
    outline_fraction: float
    """Of the silhouette's outline."""


@dataclass(frozen=True, slots=True)
class VisibilityRow:
    """Visibility of the object at rest."""

    canonical_best: float
    """Largest visible share of the silhouette in the views around it."""
    canonical_mean: float
    recognisability: float
    """Largest visible share of the outline in these views."""
    from_the_room: float
    """Mean visible share of the surface that faces people standing around it."""
    views: tuple[ViewRow, ...]


@dataclass(frozen=True, eq=False, slots=True)
class Placement:
    """A placement: the keys of placement.json, and the paths of its files."""

    schema: int
    """Version of these keys; 0 for files written before versions existed."""
    verdict: str
    """at_rest or infeasible."""
    reason: str | None
    message: str | None
    prompt: str
    base: Base | None
    candidates: tuple[CandidateRow, ...]
    part: str | None
    region: str | None
    region_missed: bool | None
    scale: float | None
    mass: float | None
    """[kg]."""
    world_from_file: Matrix | None
    object_from_file: Matrix | None
    pre_drop: Pose | None
    pose: Pose | None
    object_aabb: Bounds | None
    contacts: tuple[ContactRow, ...]
    materials: tuple[MaterialRow, ...]
    geometry: tuple[GeometryRow, ...]
    soft_bodies: tuple[SettledMaterial, ...]
    """Final states of the soft bodies; empty without a rest state."""
    certificate: Certificate | None
    """Certificate of the drop; None if an earlier stage found the placement infeasible, and after unstable_step."""
    checks: PlacementChecks | None
    """Requirements on the rest state, `placement` in the file's certificate; None if that is None."""
    evidence: NamedValues[Any]
    """Further evidence that there is no rest state: findings of a stage before the drop, or the last state of a
    drop."""
    visible_fraction: float | None
    visibility: VisibilityRow | None
    """Visibility from views around the object and from the room."""
    warnings: tuple[str, ...]
    """Messages that need action: requests not met or not understood, guesses that affect the result."""
    notes: tuple[str, ...]
    """Other steps and assumptions."""
    timings: NamedValues[float]
    """Seconds that each stage took when it was computed."""
    artifacts: NamedValues[Path]
    """Absolute paths of the files."""
    folder: Path
    """Folder of placement.json and the files."""
    tree: dict[str, Any] = field(repr=False)
    """The content of placement.json."""

    @classmethod
    def of(cls, tree: Mapping[str, Any], folder: Path) -> "Placement":
        """The placement that a folder holds."""
        place = folder.resolve()
        files = {name: place / file for name, file in tree["artifacts"].items()}
        found = tree["certificate"] or {}
        dropped = found if "signals" in found else None
        of_the_drop = {one.name for one in fields(Certificate)} if dropped else set()
        told = {
            "certificate": dropped,
            "checks": found.get("placement"),
            "evidence": {key: value for key, value in found.items() if key not in {*of_the_drop, "placement"}},
        }
        since = {"schema": 0, "soft_bodies": (), "visibility": None, "notes": ()}  # earlier files lack them
        values = {**since, **tree, **told, "artifacts": files, "folder": place, "tree": dict(tree)}
        placement: Placement = build_result(cls, values, place / "placement.json")
        return placement

    @classmethod
    def read(cls, folder: str | Path) -> "Placement":
        """The placement that `place` wrote into a folder earlier."""
        return cls.of(read_keys(Path(folder) / "placement.json"), Path(folder))

    def to_json(self) -> str:
        """The text of placement.json."""
        return json.dumps(self.tree, indent=2, allow_nan=False, ensure_ascii=False)

    def __repr__(self) -> str:
        where = f" on {self.base.label} ({self.part})" if self.base else ""
        at = f" at {rounded(self.pose.position)}" if self.pose else ""
        why = f": {self.reason}" if self.reason else ""
        return f"Placement({self.verdict}{why}{where}{at}, {warning_count(self.warnings)}folder='{self.folder}')"


@dataclass(frozen=True, slots=True)
class BodyAtRest:
    """One body of a drop at its end."""

    position: Vector
    """Of the given origin [m]; for a soft body by best-fit rigid motion."""
    quaternion: Quaternion
    aabb: Bounds
    """Of the deformed surface [m]."""
    max_speed: float
    """[m/s]."""
    max_displacement: float
    """Largest displacement of the surface from the start [m]."""


@dataclass(frozen=True, slots=True)
class Residual:
    """Unbalanced force and torque on the free bodies over their weight [-]."""

    force: float
    torque: float


@dataclass(frozen=True, eq=False, slots=True)
class Result:
    """A drop: the keys of result.json, and the paths of its files."""

    verdict: str
    """at_rest or a reason code."""
    bodies: NamedValues[BodyAtRest | None]
    """By name; None after unstable_step."""
    contacts: tuple[ContactRow, ...]
    residual: Residual | None
    resolution: float
    """Smallest cell at a contact [m]."""
    simulated_s: float | None
    relaxation_steps: int | None
    steps: int | None
    particles: int | None
    certificate: Certificate | None
    """None after unstable_step."""
    warnings: tuple[str, ...]
    wall_s: float
    timings: NamedValues[float]
    folder: Path
    """Folder of result.json, the surfaces at rest and the history."""
    tree: dict[str, Any] = field(repr=False)
    """The content of result.json."""

    @classmethod
    def of(cls, tree: Mapping[str, Any], folder: Path) -> "Result":
        """The result that a folder holds."""
        place = folder.resolve()
        result: Result = build_result(cls, {**tree, "folder": place, "tree": dict(tree)}, place / "result.json")
        return result

    @classmethod
    def read(cls, folder: str | Path) -> "Result":
        """The result that `drop` wrote into a folder earlier."""
        return cls.of(read_keys(Path(folder) / "result.json"), Path(folder))

    @property
    def artifacts(self) -> NamedValues[Path]:
        """Absolute paths of the files: one PLY per body by its name, and `history`; empty after unstable_step."""
        if self.verdict == "unstable_step":
            return NamedValues({})
        surfaces = {name: self.folder / f"{name}.ply" for name in self.bodies}
        return NamedValues({**surfaces, "history": self.folder / "history.parquet"})

    def to_json(self) -> str:
        """The text of result.json."""
        return json.dumps(self.tree, indent=2)

    def __repr__(self) -> str:
        names = ", ".join(self.bodies)
        return f"Result({self.verdict}, bodies {names}, {warning_count(self.warnings)}folder='{self.folder}')"


@cache
def adapter(kind: type) -> TypeAdapter[Any]:
    """Validator that builds a class of results from plain values."""
    return TypeAdapter(kind)


def build_result(kind: type, values: Mapping[str, Any], path: Path) -> Any:
    """A result from the values in a file; InputError names the file and the first invalid key."""
    try:
        result = adapter(kind).validate_python(values)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        where = ".".join(str(part) for part in first["loc"])
        raise InputError(f"{path}: {where}: {first['msg']} (got {first['input']!r})") from None
    return result


def rounded(position: Vector) -> list[float]:
    """A position to the millimetre."""
    return [round(value, 3) for value in position]


def warning_count(warnings: tuple[str, ...]) -> str:
    """Number of warnings in words; empty without any."""
    return f"{len(warnings)} warnings, " if warnings else ""


@cache
def placement_schema() -> JsonObject:
    """The schema."""
    found = adapter(Placement).json_schema()
    keys = {name: value for name, value in found["properties"].items() if name not in OWN}
    keys["verdict"] = {"enum": [AT_REST, "infeasible"]}
    keys["reason"] = {"enum": [None, *(one.value for one in Reason)]}
    keys["visible_fraction"] = {"anyOf": [{"type": "number", "minimum": 0, "maximum": 1}, {"type": "null"}]}
    keys["schema"] = {"const": SCHEMA_VERSION, "description": "Version of this schema."}
    keys["certificate"] = {
        "description": "Of a drop: its signals and what was asked (placement, column); else what a stage found.",
        "anyOf": [{"type": "object", "properties": certificate(found)}, {"type": "null"}],
    }
    return object_to_json(
        {
            "$schema": "https://json-schema.org/draft/2020-12/schema",
            "title": f"placement.json of dcap, version {SCHEMA_VERSION}",
            "type": "object",
            "properties": keys,
            "required": sorted(keys),
            "$defs": found["$defs"],
        }
    )


def certificate(found: Mapping[str, Any]) -> dict[str, Any]:
    """Schema of the certificate's keys."""
    known = dict(found["$defs"]["Certificate"]["properties"])
    return {**known, "placement": {"$ref": "#/$defs/PlacementChecks"}}
