"""The solid of one body of a case: its shape where it stands, what it weighs, and where another will touch it."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from dcap.geometry.distance import Distance, MeshDistance
from dcap.geometry.primitives import Box, Capsule
from dcap.geometry.solid.repair import mass_properties
from dcap.scene.errors import InputError
from dcap.scene.readers.frame.frame import Role
from dcap.scene.readers.source import read_scan
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.particles import InertialProperties
from dcap.scene.types.sample import SourceOptions
from solver.contact.predict import contact_radius
from tasks.bodies.inertial import inertial_of_solid
from tasks.bodies.soft_cells import Planes
from tasks.case.file import CaseBody, is_rigid, material_of, primitive_of

Array = NDArray[np.float64]

CELLS_PER_RADIUS = 5.0  # cells in a predicted contact radius: the two known depths within 1.2 %, 2 % are promised
CELLS_THROUGH = 4.0  # least cells through the smallest side of a soft body
OUTLINE_EDGES = 8.0  # edges in half a primitive where only its outline matters
SEEN = 0.4  # of the predicted depth: what of a face lies within it counts as flat; of a ball sqrt(0.8) of Hertz' radius
INVISIBLE = 5e-5  # a dent shallower than the penetration of the contact springs [m] is not worth resolving


class CaseSolid:
    """One body of a case between its description and the simulated body."""

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
        self.given = None if self.primitive else given_mesh(folder / str(body.shape.mesh), body.name)
        self.outline = self.placed(self._outline())
        """Points of the surface that show where it is flat [m], shape (n, 3)."""
        if isinstance(self.primitive, Capsule):
            reach = 0.5 * self.primitive.length * np.abs(self.rotation[:, 2]) + self.primitive.radius
            ends = np.stack([self.position - reach, self.position + reach])
        else:
            ends = self.outline
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
        """Local points in the world."""
        return np.asarray(points @ self.rotation.T + self.position)

    @property
    def box(self) -> Array:
        """Its box in the world [m], shape (2, 3)."""
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
        """Its box in its own frame [m], shape (2, 3)."""
        if self.primitive is not None:
            return np.stack([-self.primitive.half_extents, self.primitive.half_extents])
        return self._given().bounds

    @property
    def mass(self) -> float:
        """[kg]."""
        if self.body.mass is not None:
            return self.body.mass
        volume = self.primitive.volume if self.primitive else mass_properties(self._given(), 1.0)[0]
        return float(self.material.density * volume)

    def inertial(self) -> InertialProperties:
        """Of a solid of uniform density."""
        if self.primitive is not None:
            inertia = self.rotation @ np.diag(self.primitive.inertia_per_mass * self.mass) @ self.rotation.T
            return InertialProperties(self.mass, self.position, inertia)
        unit = inertial_of_solid(self._given(), 1.0)
        inertia = self.rotation @ (unit.inertia * (self.mass / unit.mass)) @ self.rotation.T
        return InertialProperties(self.mass, self.placed(unit.center_of_mass[None])[0], inertia)

    def surface(self, planes: Planes | None, cell: float) -> Mesh:
        """As fine as the cells [m], or the grid's own planes, so that a contact presses on every node under it."""
        if isinstance(self.primitive, Box) and planes is not None and np.allclose(self.rotation, np.eye(3)):
            local = self.primitive.surface_on([p - c for p, c in zip(planes, self.position, strict=True)])
        elif self.primitive is not None:
            local = self.primitive.surface(max(min(cell, self.smallest / 8.0), float(self.extent.max()) / 160.0))
        else:
            local = self._given()
        return Mesh.of(self.placed(local.vertices), local.faces)

    def distance(self, surface: Mesh) -> Distance:
        """Signed distance in the world: exact for a primitive, else to its surface there."""
        return MeshDistance(surface) if self.primitive is None else self.exact_distance

    def exact_distance(self, points: Array) -> Array:
        """Signed distance of a primitive at world points (n, 3), shape (n,)."""
        assert self.primitive is not None
        return self.primitive.distance((points - self.position) @ self.rotation)

    def predicted_cell(self, solids: "list[CaseSolid]", gravity: float) -> float:
        """CELLS_PER_RADIUS in the predicted contact radius, at least four cells through the thickness."""
        alone = not self.may_touch(solids)
        thickness = self.smallest / CELLS_THROUGH
        return thickness if alone else min(self.predicted_radius(solids, gravity) / CELLS_PER_RADIUS, thickness)

    def predicted_radius(self, solids: "list[CaseSolid]", gravity: float) -> float:
        """Smallest predicted contact radius with any other body [m]: Hertz where round, the face itself where flat."""
        radii = [0.5 * self.smallest]
        for other in self.may_touch(solids):
            weight = min(s.mass for s in (self, other) if not s.fixed) * gravity
            curvature = min(s.curvature_radius() for s in (self, other))
            modulus = min(s.material.youngs_modulus for s in (self, other))
            hertz = contact_radius(weight, curvature, modulus, self.material.poisson_ratio)
            hertz = max(hertz, float(np.sqrt(curvature * INVISIBLE)))
            upper, lower = sorted((self, other), key=lambda s: s.low[2] + s.high[2], reverse=True)
            depth = SEEN * hertz**2 / curvature
            radii.append(max(hertz, min(upper.flat_radius(depth, -1.0), lower.flat_radius(depth, 1.0))))
        return min(radii)

    def curvature_radius(self) -> float:
        """Radius that stands for the body's underside [m]: its own where round, else half its footprint."""
        if isinstance(self.primitive, Capsule):
            return self.primitive.radius
        return 0.5 * float(self.extent[:2].min())

    def may_touch(self, solids: "list[CaseSolid]") -> "list[CaseSolid]":
        """The bodies that it can press on: not itself, not both fixed, not bonded to each other."""
        return [
            other
            for other in solids
            if other is not self and not (self.fixed and other.fixed) and other.body.name not in self.bonded
        ]

    def flat_radius(self, depth: float, side: float) -> float:
        """Half the smaller horizontal extent [m] of what lies at most `depth` [m] below its top (`side` 1) or above its
        bottom (-1)."""
        level = side * self.outline[:, 2]
        band = self.outline[level >= level.max() - depth]
        return 0.5 * float(np.ptp(band[:, :2], axis=0).min())

    def touch_point(self, other: "CaseSolid") -> Array:
        """Where the two boxes come nearest [m]."""
        middle = 0.5 * (np.clip(other.position, self.low, self.high) + np.clip(self.position, other.low, other.high))
        return np.asarray(np.clip(middle, self.low, self.high))


def given_mesh(path: Path, name: str) -> Mesh:
    """The mesh of body `name`, in metres as it is: no axis or unit is changed; InputError names the key."""
    try:
        return read_scan(path, SourceOptions(up="z", unit="m"), Role.SCENE).mesh
    except InputError as error:
        raise type(error)(f"bodies.{name}.shape.mesh: {error}") from error
