"""The case file of `dcap drop`: its keys, their ranges, and error messages.

In: a YAML 1.2 file as in docs/formats.md. Out: a checked `Case`. Every key is checked before anything is computed; an
unknown one is an error that names the nearest known key.
"""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import BaseModel, Field, NonNegativeFloat, NonNegativeInt, PositiveFloat, ValidationError, model_validator

from dcap.geometry.primitives import Box, Capsule, Cylinder, Primitive
from dcap.knowledge.material_table import load_materials
from dcap.scene.errors import InputError, short
from dcap.scene.readers.files import BROKEN_YAML, parse_yaml, yaml_fault
from dcap.scene.text import did_you_mean
from dcap.scene.types.materials import ContactFriction, LayerConstants
from dcap.scene.types.particles import GRAVITY

RIGID_ABOVE = 1e9  # Young's modulus [Pa] above which `model: auto` is rigid (the paper's section 3)
UNIT_TOLERANCE = 0.01  # of a quaternion's length: two decimals, as people write them

LONGEST_NAME = 200  # characters of a body's name: NAME.ply is a file

Vector3 = Annotated[list[float], Field(min_length=3, max_length=3)]
Strict = {"extra": "forbid", "frozen": True, "allow_inf_nan": False}


class BoxShape(BaseModel, **Strict):
    """A box."""

    size: Annotated[list[PositiveFloat], Field(min_length=3, max_length=3)]


class SphereShape(BaseModel, **Strict):
    """A sphere."""

    radius: PositiveFloat


class CylinderShape(BaseModel, **Strict):
    """A cylinder along local z."""

    radius: PositiveFloat
    height: PositiveFloat


class CapsuleShape(BaseModel, **Strict):
    """A capsule along local z; `length` is its straight part."""

    radius: PositiveFloat
    length: NonNegativeFloat


class CaseShape(BaseModel, **Strict):
    """Exactly one of the five shapes."""

    box: BoxShape | None = None
    sphere: SphereShape | None = None
    cylinder: CylinderShape | None = None
    capsule: CapsuleShape | None = None
    mesh: str | None = None

    @model_validator(mode="after")
    def _one(self) -> "CaseShape":
        given = [k for k, v in self if v is not None]
        if len(given) != 1:
            raise ValueError(f"give exactly one of box, sphere, cylinder, capsule, mesh; got {given or 'none'}")
        return self


class CaseLayers(BaseModel, **Strict):
    """Further constants of a layered material; its modulus and Poisson ratio are then those across the layers."""

    youngs_modulus: float
    poisson_ratio: float
    shear_modulus: float
    normal: Vector3 = [0.0, 0.0, 1.0]

    @property
    def constants(self) -> LayerConstants:
        """All constants but the normal."""
        return LayerConstants(self.youngs_modulus, self.poisson_ratio, self.shear_modulus)

    @model_validator(mode="after")
    def _direction(self) -> "CaseLayers":
        if not np.linalg.norm(self.normal) > 0.0:
            raise ValueError(f"normal {self.normal} has no direction")
        return self


class CaseMaterial(BaseModel, **Strict):
    """Material constants in SI units."""

    density: PositiveFloat
    youngs_modulus: PositiveFloat
    layers: CaseLayers | None = None
    poisson_ratio: float
    static_friction: NonNegativeFloat
    dynamic_friction: NonNegativeFloat
    rolling_resistance: NonNegativeFloat = 0.0

    @property
    def problem(self) -> str:
        """Description of a value for which some strain would cost no energy; empty if there is none."""
        if self.layers is not None:
            return self.layers.constants.problem(self.youngs_modulus, self.poisson_ratio)
        inside = -1.0 < self.poisson_ratio < 0.5
        return "" if inside else f"poisson_ratio is {self.poisson_ratio:g}, must be greater than -1 and less than 0.5"

    @property
    def friction(self) -> ContactFriction:
        """Contribution of the material to a contact's friction."""
        return ContactFriction(self.static_friction, self.dynamic_friction, self.rolling_resistance)


class CaseBody(BaseModel, **Strict):
    """One body."""

    name: Annotated[str, Field(min_length=1, max_length=LONGEST_NAME, pattern=r"^[A-Za-z0-9_.-]+$")]
    shape: CaseShape
    position: Vector3
    quaternion: Annotated[list[float], Field(min_length=4, max_length=4)] = [1.0, 0.0, 0.0, 0.0]
    velocity: Vector3 = [0.0, 0.0, 0.0]
    angular_velocity: Vector3 = [0.0, 0.0, 0.0]
    motion: Literal["free", "fixed", "vertical"] = "free"
    clamp: Literal["x_min", "x_max", "y_min", "y_max", "z_min", "z_max", "bottom", "sides_and_bottom", "none"] = (
        "bottom"
    )
    rest_shape: Literal["loaded", "unloaded"] | None = None
    material: CaseMaterial | str
    mass: PositiveFloat | None = None
    model: Literal["auto", "rigid", "mpm"] = "auto"

    @model_validator(mode="after")
    def _unit(self) -> "CaseBody":
        length = float(np.linalg.norm(self.quaternion))
        if abs(length - 1.0) > UNIT_TOLERANCE:
            raise ValueError(f"quaternion {self.quaternion} has length {length:.3g} instead of 1")
        return self


class FrictionPair(BaseModel, **Strict):
    """Friction of one pair of bodies."""

    a: str
    b: str
    static_friction: NonNegativeFloat
    dynamic_friction: NonNegativeFloat


class Case(BaseModel, **Strict):
    """A whole case file."""

    gravity: Vector3 = [0.0, 0.0, -GRAVITY]
    seed: NonNegativeInt = 0
    resolution: Literal["auto"] | PositiveFloat = "auto"
    inertia: bool = False
    bodies: Annotated[list[CaseBody], Field(min_length=1)]
    bonds: list[Annotated[list[str], Field(min_length=2, max_length=2)]] = []
    friction_pairs: list[FrictionPair] = []


OWNERS: dict[object, type[BaseModel]] = {
    "bodies": CaseBody, "shape": CaseShape, "box": BoxShape, "sphere": SphereShape, "cylinder": CylinderShape,
    "capsule": CapsuleShape, "material": CaseMaterial, "layers": CaseLayers, "friction_pairs": FrictionPair,
}  # fmt: skip
"""Model of the keys below a key."""


def read_case(path: Path) -> Case:
    """The checked case of a YAML 1.2 file; raises InputError with file, key and value."""
    try:
        document = parse_yaml(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from error
    except BROKEN_YAML as error:
        raise InputError(f"{path}: is not YAML: {yaml_fault(error)}") from error
    if not isinstance(document, dict):
        raise InputError(f"{path}: holds no keys; a case needs at least `bodies`")
    return checked_case(document, str(path))


def checked_case(document: Mapping[str, object], path: str) -> Case:
    """The case of a tree of keys and values; raises InputError with `path`, the origin of the tree, key and value."""
    try:
        case = Case.model_validate(document)
    except ValidationError as error:
        raise InputError(f"{path}: {_first_complaint(error)}") from error
    for where in truth_values(document):  # now the tree is known to be finite: an alias may contain itself
        if where != "inertia":
            raise InputError(f"{path}: {where}: true and false are not numbers")
    names = [b.name for b in case.bodies]
    if len(set(names)) != len(names):
        raise InputError(f"{path}: bodies: names must differ, got {names}")
    for body in case.bodies:
        try:
            material = material_of(body)
        except InputError as error:
            raise InputError(f"{path}: {error}") from error
        if material.problem:
            raise InputError(f"{path}: bodies.{body.name}.material: {material.problem}")
        if body.motion == "fixed" and body.clamp == "none" and not is_rigid(body, material):
            raise InputError(
                f"{path}: bodies.{body.name}.clamp: a fixed soft body with clamp none would fall; name a face"
            )
        if body.motion == "vertical" and not is_rigid(body, material):
            raise InputError(f"{path}: bodies.{body.name}.motion: only a rigid body can be held to the vertical")
    if case.resolution == "auto" and not any(case.gravity):
        raise InputError(f"{path}: gravity [0, 0, 0]: no load to choose the cells by; give a resolution")
    return case


def truth_values(tree: object, where: str = "") -> Iterator[str]:
    """Places of true and false in a tree, keys joined by dots: pydantic would read them as 1 and 0."""
    if isinstance(tree, bool):
        yield where
    items = tree.items() if isinstance(tree, Mapping) else enumerate(tree) if isinstance(tree, list | tuple) else ()
    for key, value in items:
        yield from truth_values(value, f"{where}.{key}" if where else str(key))


def _first_complaint(error: ValidationError) -> str:
    """One line: key, error, value, nearest known key."""
    complaints = error.errors(include_url=False)
    first = next((c for c in complaints if c["type"] == "extra_forbidden"), complaints[0])  # a typo explains the rest
    where = ".".join(str(part) for part in first["loc"])
    if first["type"] == "extra_forbidden":
        owner = next((OWNERS[part] for part in reversed(first["loc"][:-1]) if part in OWNERS), Case)
        known = sorted(owner.model_fields)
        return f"{where}: unknown key" + (did_you_mean(first["loc"][-1], known) or f"; known are {known}")
    return f"{where}: {first['msg']} (got {short(first.get('input'))})"


def material_of(body: CaseBody) -> CaseMaterial:
    """The constants, from the case or from materials.csv."""
    if isinstance(body.material, CaseMaterial):
        return body.material
    library = load_materials()
    if body.material not in library:
        hint = did_you_mean(body.material, library)
        raise InputError(f"bodies.{body.name}.material: {body.material!r} is not in materials.csv{hint}")
    row = library[body.material]
    return CaseMaterial(
        density=row.density, youngs_modulus=row.youngs_modulus, poisson_ratio=row.poisson_ratio,
        static_friction=row.static_friction, dynamic_friction=row.dynamic_friction,
        rolling_resistance=row.rolling_resistance, layers=layers_of(row.layers),
    )  # fmt: skip


def layers_of(row: LayerConstants | None) -> CaseLayers | None:
    """Layers of a row of materials.csv, normal to the body's local z."""
    if row is None:
        return None
    return CaseLayers(
        youngs_modulus=row.youngs_modulus, poisson_ratio=row.poisson_ratio, shear_modulus=row.shear_modulus
    )


def is_rigid(body: CaseBody, material: CaseMaterial) -> bool:
    """Return whether the body is simulated as rigid."""
    return body.model == "rigid" or (body.model == "auto" and material.youngs_modulus > RIGID_ABOVE)


def primitive_of(shape: CaseShape) -> Primitive | None:
    """The primitive of a shape; None for a mesh."""
    if shape.box:
        return Box(np.asarray(shape.box.size, dtype=np.float64))
    if shape.sphere:
        return Capsule(shape.sphere.radius, 0.0)
    if shape.cylinder:
        return Cylinder(shape.cylinder.radius, shape.cylinder.height)
    if shape.capsule:
        return Capsule(shape.capsule.radius, shape.capsule.length)
    return None
