"""The solid of one body of a case: its placed shape, its mass, and its contacts with other bodies."""

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from dcap.arrays import Array
from dcap.geometry.distance import Distance, MeshDistance
from dcap.geometry.pieces import pieces_of
from dcap.geometry.primitives import Box, Capsule
from dcap.geometry.solid.closed import simulation_ready
from dcap.geometry.solid.repair import mass_properties
from dcap.geometry.solid.soundness import well_formed
from dcap.scene.errors import GeometryError, InputError
from dcap.scene.readers.frame import Role
from dcap.scene.readers.source import read_scan
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.particles import InertialProperties
from dcap.scene.types.sample import SourceOptions
from tasks.bodies.discretization import inertial_of_solid
from tasks.bodies.soft_cells import Planes
from tasks.case.file import CaseBody, is_rigid, material_of, primitive_of

OUTLINE_EDGES = 8.0  # edges in half a primitive where only its outline matters


class CaseSolid:
    """One body of a case, as an intermediate step between its description and the simulated body."""

    def __init__(self, body: CaseBody, folder: Path, bonded: frozenset[str] = frozenset()) -> None:
        self.body = body
        self.bonded = bonded
        """Names of the bodies that it is bonded to."""
        self.material = material_of(body)
        self.rigid = is_rigid(body, self.material)
        self.fixed = body.motion == "fixed"
        self.rotation = Rotation.from_quat(np.roll(body.quaternion, -1)).as_matrix()
        self.position = np.asarray(body.position)
        self.primitive = primitive_of(body.shape)
        self.given: Mesh | None = None
        self.repairs: tuple[str, ...] = ()
        """One sentence for each repair that turned its mesh into the border of a solid."""
        if self.primitive is None:
            self.given, self.repairs = given_solid(folder, body)
        if isinstance(self.primitive, Capsule):
            reach = 0.5 * self.primitive.length * np.abs(self.rotation[:, 2]) + self.primitive.radius
            ends = np.stack([self.position - reach, self.position + reach])
        else:
            ends = self.placed(self._outline())
        self.low: Array = ends.min(axis=0)
        self.high: Array = ends.max(axis=0)

    def _outline(self) -> Array:
        if self.primitive is None:
            return self._given().vertices
        if isinstance(self.primitive, Box):
            return (np.array(list(np.ndindex(2, 2, 2))) * 2.0 - 1.0) * self.primitive.half_extents
        return self.primitive.surface(float(self.primitive.half_extents.max()) / OUTLINE_EDGES).vertices

    def _given(self) -> Mesh:
        assert self.given is not None
        return self.given

    def placed(self, points: Array) -> Array:
        """Local points in world coordinates."""
        return np.asarray(points @ self.rotation.T + self.position)

    @property
    def layer_normal(self) -> Array:
        """Unit normal of its layers in the world, shape (3,)."""
        normal = self.rotation @ np.asarray(
            [0.0, 0.0, 1.0] if self.material.layers is None else self.material.layers.normal
        )
        return np.asarray(normal / np.linalg.norm(normal))

    @property
    def box(self) -> Array:
        """Its bounding box in the world [m], shape (2, 3)."""
        return np.stack([self.low, self.high])

    @property
    def extent(self) -> Array:
        """Side lengths of the world box [m]."""
        return np.asarray(self.high - self.low)

    @property
    def smallest(self) -> float:
        """Smallest side of the world box [m]."""
        return float(self.extent.min())

    @property
    def local_box(self) -> Array:
        """Its bounding box in its own frame [m], shape (2, 3)."""
        if self.primitive is not None:
            return np.stack([-self.primitive.half_extents, self.primitive.half_extents])
        return self._given().bounds

    @property
    def mass(self) -> float:
        """Mass of the body [kg]."""
        if self.body.mass is not None:
            return self.body.mass
        volume = self.primitive.volume if self.primitive else mass_properties(self._given(), 1.0)[0]
        return float(self.material.density * volume)

    @property
    def compliance(self) -> float:
        """(1 - nu^2) / E [1/Pa]; 0 if rigid."""
        m = self.material
        return 0.0 if self.rigid else (1.0 - m.poisson_ratio**2) / m.youngs_modulus

    def inertial(self) -> InertialProperties:
        """Mass properties of a solid of uniform density."""
        if self.primitive is not None:
            inertia = self.rotation @ np.diag(self.primitive.inertia_per_mass * self.mass) @ self.rotation.T
            return InertialProperties(self.mass, self.position, inertia)
        unit = inertial_of_solid(self._given(), 1.0)
        inertia = self.rotation @ (unit.inertia * (self.mass / unit.mass)) @ self.rotation.T
        return InertialProperties(self.mass, self.placed(unit.center_of_mass[None])[0], inertia)

    def surface(self, planes: Planes | None, cell: float) -> Mesh:
        """Its surface with faces as fine as the cells [m], on a soft body twice as fine: a box has points on the planes
        of its grid, so that a contact presses on every node under it, and between the planes, so that a rim counts at
        its true position."""
        if isinstance(self.primitive, Box) and planes is not None and np.allclose(self.rotation, np.eye(3)):
            halved = [np.sort(np.concatenate([p, 0.5 * (p[1:] + p[:-1])])) for p in planes]
            local = self.primitive.surface_on([p - c for p, c in zip(halved, self.position, strict=True)])
        elif self.primitive is not None:
            edge = cell if planes is None else 0.5 * cell
            local = self.primitive.surface(max(min(edge, self.smallest / 8.0), float(self.extent.max()) / 160.0))
        else:
            local = self._given()
        return Mesh.of(self.placed(local.vertices), local.faces)

    def distance(self, surface: Mesh) -> Distance:
        """Signed distance in the world: exact for a primitive, otherwise to the surface there."""
        return MeshDistance(surface) if self.primitive is None else self.exact_distance

    def exact_distance(self, points: Array) -> Array:
        """Signed distance of a primitive at world points (n, 3), shape (n,)."""
        assert self.primitive is not None
        return self.primitive.distance((points - self.position) @ self.rotation)

    def curvature_radius(self) -> float:
        """Radius that represents the body's underside [m]: its own if it is round, else half its footprint."""
        if isinstance(self.primitive, Capsule):
            return self.primitive.radius
        return 0.5 * float(self.extent[:2].min())

    def may_touch(self, solids: "list[CaseSolid]") -> "list[CaseSolid]":
        """The bodies on which it can press: not itself, not both fixed, not bonded to each other."""
        return [
            other
            for other in solids
            if other is not self and not (self.fixed and other.fixed) and other.body.name not in self.bonded
        ]


def given_solid(folder: Path, body: CaseBody) -> tuple[Mesh, tuple[str, ...]]:
    """The mesh of a body as the border of one solid, in metres, and its repairs.

    Axes and units are unchanged. InputError names the key if the file cannot be read or is not the border of a solid.
    """
    try:
        mesh = read_scan(folder / str(body.shape.mesh), SourceOptions(up="z", unit="m"), Role.SCENE).mesh
        if len(pieces_of(mesh)) == 1 and well_formed(mesh):
            return mesh, ()
        solid, report = simulation_ready(mesh)
    except (InputError, GeometryError) as error:
        raise InputError(f"bodies.{body.name}.shape.mesh: {error}") from error
    if report.problem:
        raise InputError(
            f"bodies.{body.name}.shape.mesh: it is not the border of a solid, and after repair {report.problem}"
        )
    return solid, tuple(f"{body.name}: {sentence}" for sentence in report.repairs)
