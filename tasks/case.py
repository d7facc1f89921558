"""`dcap drop`: a physics case from a YAML file to `result.json`, one PLY per body at rest and `history.parquet`.

In: a case file as in docs/formats.md. Out: a folder. Every key is checked before anything is computed; an unknown one is an error
that names the nearest known key.
"""

import difflib
import json
import shutil
import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
from numpy.typing import NDArray
from pydantic import BaseModel, Field, NonNegativeFloat, PositiveFloat, ValidationError, model_validator
from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError
from scipy.spatial.transform import Rotation

from geometry.distance import distance_grid, sampler
from geometry.fill import Distance, fill
from geometry.primitives import Box, Capsule, Cylinder, Primitive
from geometry.repair import mass_properties
from language.materials import load_materials
from scene.codec import mesh_to_ply
from scene.errors import InputError
from scene.mesh import Mesh
from scene.particles import DistanceGrid
from scene.readers.frame import Role
from scene.readers.source import read_scan
from scene.sample import SourceOptions
from solver.certificate import Signals
from solver.config import SolverConfig
from solver.errors import ModelError, UnstableStep
from solver.grid import graded_planes
from solver.model import FREE, HELD, Body, Model, SignedDistance, SoftParts
from solver.predict import contact_radius
from solver.settle import Result, settle

RIGID_ABOVE = 1e9  # Young's modulus [Pa] above which `model: auto` is rigid (the paper's section 3)
CELLS_PER_RADIUS = 6.0  # cells in a predicted contact radius
CELLS_THROUGH = 4.0  # least cells through the smallest side of a soft body
FINE_REACH = 1.3  # half width of the fine zone over the predicted contact radius
GROWTH = 1.4  # ratio of neighbouring cells outside of the fine zone
MOST_CELLS = 60_000  # cells of one soft body; more would not fit the time a user expects
"""What a person can raise with --resolution."""

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


class Shape(BaseModel, **Strict):
    """Exactly one of the five."""

    box: BoxShape | None = None
    sphere: SphereShape | None = None
    cylinder: CylinderShape | None = None
    capsule: CapsuleShape | None = None
    mesh: str | None = None

    @model_validator(mode="after")
    def _one(self) -> "Shape":
        given = [k for k, v in self if v is not None]
        if len(given) != 1:
            raise ValueError(f"give exactly one of box, sphere, cylinder, capsule, mesh; got {given or 'none'}")
        return self


class CaseMaterial(BaseModel, **Strict):
    """Material constants in SI units."""

    density: PositiveFloat
    youngs_modulus: PositiveFloat
    poisson_ratio: Annotated[float, Field(gt=-1.0, lt=0.5)]
    static_friction: NonNegativeFloat
    dynamic_friction: NonNegativeFloat
    rolling_resistance: NonNegativeFloat = 0.0


class CaseBody(BaseModel, **Strict):
    """One body."""

    name: Annotated[str, Field(min_length=1, pattern=r"^[A-Za-z0-9_.-]+$")]
    shape: Shape
    position: Vector3
    quaternion: Annotated[list[float], Field(min_length=4, max_length=4)] = [1.0, 0.0, 0.0, 0.0]
    velocity: Vector3 = [0.0, 0.0, 0.0]
    angular_velocity: Vector3 = [0.0, 0.0, 0.0]
    motion: Literal["free", "fixed"] = "free"
    clamp: Literal["x_min", "x_max", "y_min", "y_max", "z_min", "z_max", "bottom", "sides_and_bottom", "none"] = (
        "bottom"
    )
    rest_shape: Literal["loaded", "unloaded"] | None = None
    material: CaseMaterial | str
    mass: PositiveFloat | None = None
    model: Literal["auto", "rigid", "mpm"] = "auto"


class FrictionPair(BaseModel, **Strict):
    """Friction of one pair of bodies."""

    a: str
    b: str
    static_friction: NonNegativeFloat
    dynamic_friction: NonNegativeFloat


class Case(BaseModel, **Strict):
    """A whole case file."""

    gravity: Vector3 = [0.0, 0.0, -9.81]
    seed: int = 0
    resolution: Literal["auto"] | PositiveFloat = "auto"
    inertia: bool = False
    bodies: Annotated[list[CaseBody], Field(min_length=1)]
    bonds: list[Annotated[list[str], Field(min_length=2, max_length=2)]] = []
    friction_pairs: list[FrictionPair] = []


def read_case(path: Path) -> Case:
    """The checked case of a YAML 1.2 file; raises InputError with file, key and value."""
    try:
        document = YAML(typ="safe", pure=True).load(path.read_text())
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from error
    except (YAMLError, UnicodeDecodeError) as error:
        raise InputError(f"{path}: is not YAML: {' '.join(str(error).split())}") from error
    try:
        case = Case.model_validate(document)
    except ValidationError as error:
        raise InputError(f"{path}: {_first_complaint(error)}") from error
    names = [b.name for b in case.bodies]
    if len(set(names)) != len(names):
        raise InputError(f"{path}: bodies: names must differ, got {names}")
    for body in case.bodies:
        if body.motion == "fixed" and body.clamp == "none" and not is_rigid(body, material_of(body)):
            raise InputError(
                f"{path}: bodies.{body.name}.clamp: a fixed soft body with clamp none would fall; name a face"
            )
    if case.inertia:
        raise InputError(f"{path}: inertia: true-mass elastodynamics is not available; remove the key")
    if case.bonds:
        raise InputError(f"{path}: bonds: bonded bodies are not available in a case file; remove the key")
    return case


def _first_complaint(error: ValidationError) -> str:
    """One line: key, what is wrong, which value, nearest known key."""
    complaints = error.errors(include_url=False)
    first = next((c for c in complaints if c["type"] == "extra_forbidden"), complaints[0])  # a typo explains the rest
    where = ".".join(str(part) for part in first["loc"])
    if first["type"] == "extra_forbidden":
        known = sorted({*Case.model_fields, *CaseBody.model_fields, *CaseMaterial.model_fields, *Shape.model_fields})
        near = difflib.get_close_matches(str(first["loc"][-1]), known, n=1)
        return f"{where}: unknown key" + (f"; did you mean {near[0]!r}?" if near else f"; known are {known}")
    return f"{where}: {first['msg']} (got {first.get('input')!r})"


def material_of(body: CaseBody) -> CaseMaterial:
    """The constants, from the case or from materials.csv."""
    if isinstance(body.material, CaseMaterial):
        return body.material
    library = load_materials()
    if body.material not in library:
        near = difflib.get_close_matches(body.material, library, n=1)
        hint = f"; did you mean {near[0]!r}?" if near else ""
        raise InputError(f"bodies.{body.name}.material: {body.material!r} is not in materials.csv{hint}")
    row = library[body.material]
    return CaseMaterial(
        density=row.density, youngs_modulus=row.youngs_modulus, poisson_ratio=row.poisson_ratio,
        static_friction=row.static_friction, dynamic_friction=row.dynamic_friction, rolling_resistance=row.rolling_resistance,
    )  # fmt: skip


def is_rigid(body: CaseBody, material: CaseMaterial) -> bool:
    """Whether the body is simulated as rigid."""
    return body.model == "rigid" or (body.model == "auto" and material.youngs_modulus > RIGID_ABOVE)


def run_case(
    path: Path, out: Path, *, solver: str = "tl", resolution: float | None = None, threads: int = 0, quiet: bool = False
) -> dict[str, object]:
    """Read, simulate and write a case; returns the content of result.json. The folder appears whole or not at all."""
    if solver != "tl":
        raise InputError(f"--solver {solver}: only tl is available")
    case = read_case(path)
    begin = time.perf_counter()
    chosen = resolution or (case.resolution if isinstance(case.resolution, float) else None)
    bodies, cell = build_bodies(case, path.parent, chosen)
    pairs = tuple((p.a, p.b, p.static_friction, p.dynamic_friction) for p in case.friction_pairs)
    built = time.perf_counter()
    try:
        model = Model(tuple(bodies), np.asarray(case.gravity, dtype=np.float64), pairs)
        result = settle(model, SolverConfig(threads=threads, seed=case.seed), None if quiet else _progress)
    except ModelError as error:
        raise InputError(f"{path}: {error}") from error
    except UnstableStep as error:
        return _broken(error, cell, time.perf_counter() - built)
    done = time.perf_counter()
    summary = summarise(case, bodies, result, cell)
    summary |= {"wall_s": done - built, "timings": {"build_s": built - begin, "drop_s": done - built}}
    write_case(out, summary, bodies, result)
    return summary


def _progress(step: int, seconds: float, signals: Signals) -> None:
    if step % 10 == 0:
        print(
            f"step {step:4d}  t = {seconds:6.3f} s  speed {signals.speed:9.2e} m/s  "
            f"unbalanced force {signals.force_residual:8.1e}",
            file=sys.stderr,
        )


def _broken(error: UnstableStep, cell: float, wall: float) -> dict[str, object]:
    return {"verdict": "unstable_step", "warnings": [str(error)], "resolution": cell, "wall_s": wall, "timings": {}}


def build_bodies(case: Case, folder: Path, resolution: float | None) -> tuple[list[Body], float]:
    """Solver bodies of a case and the smallest cell at a contact [m]."""
    solids = [Solid(body, folder) for body in case.bodies]
    gravity = float(np.linalg.norm(case.gravity))
    cells = [resolution or s.predicted_cell(solids, gravity) for s in solids]
    finest = min(
        [c for s, c in zip(solids, cells, strict=True) if not s.rigid] or [min(s.smallest / 40 for s in solids)]
    )
    return [s.build(c, finest, solids, gravity) for s, c in zip(solids, cells, strict=True)], finest


class Solid:
    """One body of a case between its description and the solver's arrays."""

    def __init__(self, body: CaseBody, folder: Path) -> None:
        self.body = body
        self.material = material_of(body)
        self.rigid = is_rigid(body, self.material)
        self.fixed = body.motion == "fixed"
        self.rotation = Rotation.from_quat(np.roll(body.quaternion, -1)).as_matrix()
        self.position = np.asarray(body.position)
        self.primitive = primitive_of(body.shape)
        self.given = None if self.primitive else given_mesh(folder / str(body.shape.mesh))
        if isinstance(self.primitive, Capsule):
            reach = 0.5 * self.primitive.length * np.abs(self.rotation[:, 2]) + self.primitive.radius
            outline = np.stack([self.position - reach, self.position + reach])
        elif self.primitive is not None:
            corners = np.array(list(np.ndindex(2, 2, 2))) * 2.0 - 1.0
            outline = self.placed(corners * self.primitive.half_extents)
        else:
            outline = self.placed(self._given().vertices)
        self.low: NDArray[np.float64] = outline.min(axis=0)
        self.high: NDArray[np.float64] = outline.max(axis=0)

    def placed(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        """Local points in the world."""
        return np.asarray(points @ self.rotation.T + self.position)

    @property
    def extent(self) -> NDArray[np.float64]:
        """Side lengths of the world box [m]."""
        return np.asarray(self.high - self.low)

    @property
    def smallest(self) -> float:
        """Smallest side of the world box [m]."""
        return float(self.extent.min())

    @property
    def mass(self) -> float:
        """[kg]."""
        if self.body.mass is not None:
            return self.body.mass
        volume = self.primitive.volume if self.primitive else mass_properties(self._given(), 1.0)[0]
        return float(self.material.density * volume)

    def _given(self) -> Mesh:
        assert self.given is not None
        return self.given

    def predicted_cell(self, solids: "list[Solid]", gravity: float) -> float:
        """A sixth of the predicted contact radius, at least four cells through the thickness."""
        alone = all(other is self or (self.fixed and other.fixed) for other in solids)
        thickness = self.smallest / CELLS_THROUGH
        return thickness if alone else min(self.predicted_radius(solids, gravity) / CELLS_PER_RADIUS, thickness)

    def predicted_radius(self, solids: "list[Solid]", gravity: float) -> float:
        """Smallest predicted contact radius with any other body [m]."""
        radii = [0.5 * self.smallest]
        for other in solids:
            if other is self or (self.fixed and other.fixed):
                continue
            weight = min(s.mass for s in (self, other) if not s.fixed) * gravity
            curvature = min(s.curvature_radius() for s in (self, other))
            modulus = min(s.material.youngs_modulus for s in (self, other))
            radii.append(contact_radius(weight, curvature, modulus, self.material.poisson_ratio))
        return min(radii)

    def curvature_radius(self) -> float:
        """Radius that stands for the body's underside [m]: its own where round, else half its footprint."""
        if isinstance(self.primitive, Capsule):
            return self.primitive.radius
        return 0.5 * float(self.extent[:2].min())

    def build(self, cell: float, finest: float, solids: "list[Solid]", gravity: float) -> Body:
        """The solver's body."""
        edge = max(min(cell if not self.rigid else finest, self.smallest / 8.0), float(self.extent.max()) / 160.0)
        local = self.primitive.surface(edge) if self.primitive else self._given()
        surface = Mesh.of(self.placed(local.vertices), local.faces)
        spacing = max(min(finest / 2.5, self.smallest / 24.0), float(self.extent.max()) / 200.0)
        distance = self._distance(surface, spacing)
        mass, center, inertia = self._mass_properties()
        soft = None
        if not self.rigid:
            soft = self._soft(cell, solids, gravity, distance)
            soft = replace(soft, density=soft.density * (mass / float((soft.volume * soft.density).sum())))
        m = self.material
        return Body(
            self.body.name, self.fixed, surface.vertices, surface.faces,
            SignedDistance(distance.origin, distance.spacing, distance.values), mass, center, inertia, m.static_friction,
            m.dynamic_friction, m.rolling_resistance, soft, np.asarray(self.body.velocity),
            np.asarray(self.body.angular_velocity),
        )  # fmt: skip

    def _distance(self, surface: Mesh, spacing: float) -> DistanceGrid:
        margin = max(4.0 * spacing, 0.02)
        if self.primitive is None:
            return distance_grid(surface, self.low - margin, self.high + margin, spacing)
        axes = [np.arange(a, b + spacing, spacing) for a, b in zip(self.low - margin, self.high + margin, strict=True)]
        points = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1)
        values = self.primitive.distance((points - self.position) @ self.rotation).astype(np.float32)
        return DistanceGrid(np.array([a[0] for a in axes]), spacing, values)

    def _mass_properties(self) -> tuple[float, NDArray[np.float64], NDArray[np.float64]]:
        if self.primitive is not None:
            inertia = self.rotation @ np.diag(self.primitive.inertia_per_mass * self.mass) @ self.rotation.T
            return self.mass, self.position, inertia
        volume, center, unit = mass_properties(self._given(), 1.0)
        density = self.mass / volume
        return self.mass, self.placed(center[None])[0], self.rotation @ (unit * density) @ self.rotation.T

    def _soft(self, cell: float, solids: "list[Solid]", gravity: float, distance: DistanceGrid) -> SoftParts:
        planes = self._planes(cell, solids, gravity)
        count = int(np.prod([len(p) - 1 for p in planes]))
        if count > MOST_CELLS:
            raise InputError(
                f"body {self.body.name!r}: {count} cells of {1e3 * cell:.2g} mm > {MOST_CELLS}; raise --resolution"
            )
        position, volume = fill(planes, self._signed_distance(distance))
        one = np.ones(len(position))
        m = self.material
        loaded = (self.body.rest_shape or ("loaded" if self.fixed else "unloaded")) == "loaded"
        return SoftParts(
            position, volume, m.density * one, m.youngs_modulus * one, m.poisson_ratio * one, planes,
            self._held(planes, cell), loaded,
        )  # fmt: skip

    def _signed_distance(self, grid: DistanceGrid) -> Distance:
        """Exact for primitives, interpolated for meshes."""
        if self.primitive is None:
            return sampler(grid)
        primitive = self.primitive
        return lambda points: primitive.distance((points - self.position) @ self.rotation)

    def _planes(
        self, cell: float, solids: "list[Solid]", gravity: float
    ) -> tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]:
        """Graded planes: fine where another body stands over or under this one."""
        reach = FINE_REACH * self.predicted_radius(solids, gravity)
        low, high = self.high.copy(), self.low.copy()
        for other in solids:
            if other is self or (self.fixed and other.fixed):
                continue
            middle = self.touch_point(other)
            low, high = np.minimum(low, middle - reach), np.maximum(high, middle + reach)
        if (low > high).any():
            low, high = self.low, self.high
        x, y, z = (
            graded_planes(float(a), float(b), float(c), float(d), cell, GROWTH)
            for a, b, c, d in zip(self.low, self.high, low, high, strict=True)
        )
        return x, y, z

    def touch_point(self, other: "Solid") -> NDArray[np.float64]:
        """Where the two boxes come nearest [m]."""
        return 0.5 * (
            np.clip(other.position, self.low, self.high) + np.clip(self.position, other.low, other.high)
        ).clip(self.low, self.high)

    def _held(self, planes: tuple[NDArray[np.float64], ...], cell: float) -> NDArray[np.int8]:
        """Nodes of a fixed body within half a cell of its clamped faces."""
        shape = tuple(len(p) for p in planes)
        state = np.full(shape, FREE, dtype=np.int8)
        if not self.fixed:
            return state
        grid = np.stack(np.meshgrid(*planes, indexing="ij"), axis=-1)
        local = (grid - self.position) @ self.rotation
        box = self._local_box()
        for face in clamped_faces(self.body.clamp):
            axis, side = "xyz".index(face[0]), 0 if face.endswith("min") else 1
            state[np.abs(local[..., axis] - box[side][axis]) <= 0.5 * cell] = HELD
        return state

    def _local_box(self) -> NDArray[np.float64]:
        if self.primitive is not None:
            return np.stack([-self.primitive.half_extents, self.primitive.half_extents])
        return self._given().bounds


def given_mesh(path: Path) -> Mesh:
    """The mesh of a case, in metres as it is: no axis or unit is changed."""
    return read_scan(path, SourceOptions(up="z", unit="m"), Role.OBJECT).mesh


def clamped_faces(clamp: str) -> list[str]:
    """Faces named by a clamp."""
    if clamp == "sides_and_bottom":
        return ["x_min", "x_max", "y_min", "y_max", "z_min"]
    return {"bottom": ["z_min"], "none": []}.get(clamp, [clamp])


def primitive_of(shape: Shape) -> Primitive | None:
    """The primitive of a shape, None for a mesh."""
    if shape.box:
        return Box(np.asarray(shape.box.size, dtype=np.float64))
    if shape.sphere:
        return Capsule(shape.sphere.radius, 0.0)
    if shape.cylinder:
        return Cylinder(shape.cylinder.radius, shape.cylinder.height)
    if shape.capsule:
        return Capsule(shape.capsule.radius, shape.capsule.length)
    return None


def summarise(case: Case, bodies: list[Body], result: Result, cell: float) -> dict[str, object]:
    """result.json without times."""
    described = {}
    for given, body, rest in zip(case.bodies, bodies, result.bodies, strict=True):
        start = Rotation.from_quat(np.roll(given.quaternion, -1))
        turned = Rotation.from_matrix(rest.rotation) * start
        described[body.name] = {
            "position": (rest.rotation @ np.asarray(given.position) + rest.translation).tolist(),
            "quaternion": turned.as_quat(canonical=True, scalar_first=True).tolist(),
            "aabb": [rest.vertices.min(axis=0).tolist(), rest.vertices.max(axis=0).tolist()],
            "max_speed": rest.speed,
            "max_displacement": float(np.linalg.norm(rest.vertices - body.vertices, axis=1).max()),
        }
    signals = result.certificate["signals"]
    assert isinstance(signals, dict)
    return {
        "verdict": result.verdict,
        "bodies": described,
        "contacts": list(result.contacts),
        "residual": {"force": signals["force_residual"]["value"], "torque": signals["torque_residual"]["value"]},
        "resolution": cell,
        "simulated_s": result.simulated_seconds,
        "relaxation_steps": int(result.history["newton"].sum()),
        "steps": result.steps,
        "particles": result.particles,
        "certificate": result.certificate,
        "warnings": list(result.warnings),
    }


def write_case(out: Path, summary: dict[str, object], bodies: list[Body], result: Result) -> None:
    """Write the folder beside its final place, then move it there."""
    out.parent.mkdir(parents=True, exist_ok=True)
    draft = Path(tempfile.mkdtemp(prefix=f".{out.name}-", dir=out.parent))
    for body, rest in zip(bodies, result.bodies, strict=True):
        (draft / f"{body.name}.ply").write_bytes(mesh_to_ply(Mesh.of(rest.vertices, body.faces)))
    pq.write_table(pa.table({k: pa.array(v) for k, v in result.history.items()}), draft / "history.parquet")
    (draft / "result.json").write_text(json.dumps(summary, indent=2) + "\n")
    if out.exists():
        shutil.rmtree(out)
    draft.rename(out)
