"""The folder written by a placement, as a scene for the next one: geometry from scene.glb, the rest from scene.json.

scene.json describes each instance of scene.glb in the world frame (metres, z up), its materials, which instances were
placed and may move, and which surfaces are deformed by which loads (deformed_N.ply). None of that is guessed again.
`SceneFile` is the file's schema, `dcap.scene.writers.placed_scene` writes it.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, BeforeValidator, Field, FiniteFloat, NonNegativeInt, PositiveFloat, ValidationError
from scipy.spatial import cKDTree

from dcap.scene.errors import FormatError, GeometryError, InputError
from dcap.scene.readers.files import read_json
from dcap.scene.readers.mesh.ply import read_header, read_ply, read_tables, scalar
from dcap.scene.types.boxes import OrientedBox
from dcap.scene.types.earlier import Deformation, EarlierPlacements, PlacedThing
from dcap.scene.types.materials import BodyModel, LayerConstants, Material, PartMaterial
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.segmentation import Instance, Part

SCENE, FACTS, OBJECT_MESH = "scene.glb", "scene.json", "object.ply"
RESULT = "placement.json"
SHIFT = ("dx", "dy", "dz")
"""Properties of the vertices of a deformed surface: displacement from their unloaded positions [m]."""
VERSION = 1
"""Version of scene.json; other versions are refused."""
DEFORMED = "deformed_*.ply"
"""Names of the files of deformed surfaces."""
OBJECT_NODE = "object"
"""Name of the node in scene.glb for the thing that was placed last."""


def _listed(value: object) -> object:
    """An array as a list; anything else unchanged."""
    return value.tolist() if isinstance(value, np.ndarray) else value


Vector = Annotated[list[FiniteFloat], Field(min_length=3, max_length=3), BeforeValidator(_listed)]
Share = Annotated[FiniteFloat, Field(ge=0.0, le=1.0)]
Run = tuple[NonNegativeInt, NonNegativeInt]
Positive = Annotated[PositiveFloat, Field(allow_inf_nan=False)]
Friction = Annotated[FiniteFloat, Field(ge=0.0)]


class Entry(BaseModel, frozen=True, extra="forbid", from_attributes=True):
    """An object of scene.json; from a tree, or from a value with the same attributes."""


class LayerEntry(Entry, frozen=True):
    """Constants that layers add to a material."""

    youngs_modulus: Positive
    poisson_ratio: FiniteFloat
    shear_modulus: Positive


class MaterialEntry(Entry, frozen=True):
    """Material of a part in the simulation."""

    id: str
    model: Literal["rigid", "mpm"]
    density: Positive
    youngs_modulus: Positive
    poisson_ratio: Annotated[FiniteFloat, Field(gt=-1.0, lt=0.5)]
    static_friction: Friction
    dynamic_friction: Friction
    rolling_resistance: Friction
    kind: str
    source: str
    reason: str
    layers: LayerEntry | None = None


class BoxEntry(Entry, frozen=True):
    """A box with a rotation about the vertical."""

    center: Vector
    axes: Annotated[list[Vector], Field(min_length=3, max_length=3), BeforeValidator(_listed)]
    half_extents: Vector


class PartEntry(Entry, frozen=True):
    """A part of an instance."""

    name: str
    confidence: Share
    box: BoxEntry
    material: MaterialEntry | None = None
    faces: list[Run] | None = None
    """For the thing placed last: runs of faces of object.ply, first and one past the last."""


class PlacedEntry(Entry, frozen=True):
    """Entry of an instance that may move: its mass, carriers and prompt."""

    mass: Positive
    carried_by: list[str]
    prompt: str


class InstanceEntry(Entry, frozen=True):
    """One thing."""

    id: str
    label: str
    structure: bool
    confidence: Share
    guesses: list[tuple[str, FiniteFloat]]
    front: Vector | None
    box: BoxEntry
    parts: Annotated[list[PartEntry], Field(min_length=1)]
    placed: PlacedEntry | None = None


class DeformationEntry(Entry, frozen=True):
    """An instance under its loads."""

    instance: str
    loads: Annotated[list[str], Field(min_length=1)]
    file: Annotated[str, Field(pattern=r"^deformed_[0-9]+\.ply$")]
    """PLY of the deformed surface, with the shift of each vertex as dx, dy, dz."""
    largest_m: FiniteFloat
    """Largest shift, for people [m]."""


class SceneFile(Entry, frozen=True):
    """Content of scene.json."""

    version: int
    up: Literal["z"]
    unit: Literal["m"]
    object: str | None
    """Id of the thing that is the node `object` in scene.glb; null: there is no such node."""
    instances: list[InstanceEntry]
    touching: list[tuple[str, str]]
    deformations: list[DeformationEntry]


def is_placed_scene(folder: Path) -> bool:
    """Return whether a folder was written by a placement."""
    return folder.is_dir() and ((folder / FACTS).is_file() or all((folder / one).is_file() for one in (RESULT, SCENE)))


def placed_scene_files(folder: Path) -> list[Path]:
    """The files of such a folder that make up its scene; raises InputError if one is missing."""
    for name, why in ((FACTS, "what its things are and weigh"), (SCENE, "its geometry")):
        if not (folder / name).is_file():
            raise InputError(
                f"{folder}: {name} is missing, which says {why}; place again into it, or give {SCENE} by itself"
                if name == FACTS else f"{folder}: {name} is missing, which holds {why}; place again into it"
            )  # fmt: skip
    deformed = sorted(folder.glob(DEFORMED))
    return [folder / SCENE, folder / FACTS, *(one for one in (folder / OBJECT_MESH, *deformed) if one.is_file())]


def read_facts(folder: Path) -> SceneFile:
    """scene.json, checked; raises FormatError with the place of the problem."""
    path = folder / FACTS
    tree = read_json(path)
    version = tree.get("version") if isinstance(tree, dict) else None
    if version != VERSION:
        raise FormatError(f"{path}: version {version!r} of the format, this program reads {VERSION}; place again")
    try:
        facts = SceneFile.model_validate(tree)
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        place = "".join(f"[{one}]" if isinstance(one, int) else f".{one}" for one in first["loc"]).lstrip(".")
        value = first["input"]
        shown = f" {value!r}" if isinstance(value, str | int | float) else ""
        raise FormatError(f"{path}: {place}{shown}: {first['msg']}") from None
    check_names(path, facts)
    return facts


def check_names(path: Path, facts: SceneFile) -> None:
    """Refuse names that refer to nothing, or to several things."""
    known = [one.id for one in facts.instances]
    twice = next((one for one in known if known.count(one) > 1), None)
    if twice is not None:
        raise FormatError(f"{path}: instance id {twice!r} is given twice")
    placed = {one.id for one in facts.instances if one.placed is not None}
    named = [("object", [facts.object] if facts.object is not None else [], placed)]
    named += [(f"{one.id}.carried_by", one.placed.carried_by, set(known)) for one in facts.instances if one.placed]
    named += [("touching", list(pair), set(known)) for pair in facts.touching]
    named += [("deformations", [one.instance], set(known)) for one in facts.deformations]
    named += [("loads", one.loads, placed) for one in facts.deformations]
    for where, names, allowed in named:
        for name in names:
            if name not in allowed:
                what = "a thing that was placed" if allowed is placed else "an instance"
                raise FormatError(f"{path}: {where} names {name!r}, which is not {what} of this file")


def read_earlier(folder: Path, facts: SceneFile) -> EarlierPlacements:
    """The content in the form that the stages use."""
    try:
        instances = tuple(instance_of(one) for one in facts.instances)
    except GeometryError as error:
        raise FormatError(f"{folder / FACTS}: {error}") from None
    return EarlierPlacements(
        instances=instances,
        materials=tuple(
            material_of(one.id, index, part)
            for one in facts.instances
            for index, part in enumerate(one.parts)
            if part.material is not None
        ),
        placed=tuple(
            PlacedThing(one.id, one.placed.mass, tuple(one.placed.carried_by), one.placed.prompt)
            for one in facts.instances
            if one.placed is not None
        ),
        touching=tuple(facts.touching),
        deformations=tuple(read_deformation(folder, one) for one in facts.deformations),
    )


def read_deformation(folder: Path, entry: DeformationEntry) -> Deformation:
    """A surface under its loads."""
    path = folder / entry.file
    if not path.is_file():
        raise FormatError(f"{folder}: {entry.file} is missing, which {FACTS} names; place again")
    raw = read_ply(path)
    vertex = read_tables(path, read_header(path))["vertex"]
    shift = np.stack([scalar(path, vertex, name) for name in SHIFT], axis=1).astype(np.float64)
    if not np.isfinite(shift).all():
        raise FormatError(
            f"{path}: vertex {int(np.argmin(np.isfinite(shift).all(axis=1)))} has a shift that is not finite"
        )
    return Deformation(entry.instance, tuple(entry.loads), Mesh.of(raw.vertices, raw.faces), shift)


def instance_of(entry: InstanceEntry) -> Instance:
    """An instance of scene.json."""
    parts = tuple(Part(one.name, box_of(one.box), one.confidence) for one in entry.parts)
    front = None if entry.front is None else np.array(entry.front)
    return Instance(
        entry.id, entry.label, box_of(entry.box), parts, front, structure=entry.structure,
        confidence=entry.confidence, guesses=tuple(entry.guesses), placed=entry.placed is not None,
    )  # fmt: skip


def box_of(entry: BoxEntry) -> OrientedBox:
    """A box of scene.json."""
    return OrientedBox(np.array(entry.center), np.array(entry.axes), np.array(entry.half_extents))


def material_of(body: str, index: int, part: PartEntry) -> PartMaterial:
    """Material of a part of scene.json."""
    entry = part.material
    assert entry is not None
    layers = None if entry.layers is None else LayerConstants(**entry.layers.model_dump())
    material = Material(**entry.model_dump(exclude={"model", "reason", "layers"}), layers=layers)
    return PartMaterial(body, part.name, index, material, BodyModel(entry.model), entry.reason)


# nodes and parts ---------------------------------------------------------------------------------------------


def named_nodes(path: Path, facts: SceneFile, names: Sequence[str], labels: Sequence[str | None]) -> list[str]:
    """The node of each node of scene.glb as `id/part`, '' for one that belongs to nothing, and only the id for the
    thing placed last. Raises FormatError if the file and scene.json do not contain the same things."""
    known = {one.id for one in facts.instances}
    found = []
    for name, label in zip(names, labels or (None,) * len(names), strict=True):
        top = name.split("/")[0]
        if label is None and top == OBJECT_NODE and facts.object is not None:
            found.append(facts.object)
        elif label is None or label == "":
            found.append("")
        elif top not in known:
            raise FormatError(f"{path}: node {top!r} is not an instance of {FACTS} next to it")
        else:
            found.append("/".join(name.split("/")[:2]))
    missing = {one.id for one in facts.instances if one.placed is not None} - {one.split("/")[0] for one in found}
    if missing:
        raise FormatError(f"{path}: it has no node of {sorted(missing)[0]!r}, which {FACTS} lists as placed")
    return found


def parts_of_last(path: Path, entry: InstanceEntry, given: Mesh, centers: NDArray[np.float64]) -> NDArray[np.int64]:
    """The part of faces of the thing placed last, with the given middles (n, 3): the part of the nearest face of
    object.ply."""
    if len(entry.parts) == 1:
        return np.zeros(len(centers), dtype=np.int64)
    owner = np.zeros(len(given.faces), dtype=np.int64)
    for number, part in enumerate(entry.parts):
        for first, last in part.faces or []:
            if not first <= last <= len(given.faces):
                raise FormatError(f"{path}: {entry.id}, {part.name}: faces {first} to {last} of {len(given.faces)}")
            owner[first:last] = number
    nearest = np.asarray(cKDTree(given.triangles.mean(axis=1)).query(centers)[1], dtype=np.int64)
    return np.asarray(owner[nearest])
