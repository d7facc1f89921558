"""Solver bodies of a physics case: surfaces, signed distances, graded grids and particles, fine at the contact."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from dcap.geometry.distance import Distance, distance_grid, sampled, sampler
from dcap.geometry.primitives import Box, Capsule
from dcap.geometry.solid.fill import fill
from dcap.geometry.solid.repair import mass_properties
from dcap.scene.errors import InputError
from dcap.scene.readers.frame import Role
from dcap.scene.readers.source import read_scan
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.particles import DistanceGrid
from dcap.scene.types.sample import SourceOptions
from solver.contact.predict import contact_radius
from solver.model.bodies import FREE, HELD, Body, Interior, RigidBody, SignedDistance, SoftBody
from solver.model.grid import graded_planes
from tasks.case.file import Case, CaseBody, is_rigid, material_of, primitive_of

CELLS_PER_RADIUS = 5.0  # cells in a predicted contact radius: the two known depths within 1.2 %, 2 % are promised
CELLS_THROUGH = 4.0  # least cells through the smallest side of a soft body
RIGID_CELLS = 25.0  # in the smallest side where nothing is soft: spacing of surface points
FINE_REACH = 1.3  # half width of the fine zone over the predicted contact radius
OUTLINE_EDGES = 8.0  # edges in half a primitive where only its outline matters
GROWTH = 2.2  # ratio of neighbouring cells outside of the fine zone
SEEN = 0.4  # of the predicted depth: what of a face lies within it counts as flat; of a ball sqrt(0.8) of Hertz' radius
MOST_MARGIN = 0.02  # a signed distance reaches this far beyond the body [m], half its thickness for small ones
INVISIBLE = 5e-5  # a dent shallower than the penetration of the contact springs [m] is not worth resolving
MOST_SAMPLES = 250.0  # of a signed distance along its longest side: 16 million in a cube
MOST_CELLS = 200_000  # cells of one soft body; more would not fit the time a user expects
"""What a person can raise with --resolution."""

Planes = tuple[NDArray[np.float64], NDArray[np.float64], NDArray[np.float64]]


def build_bodies(case: Case, folder: Path, resolution: float | None) -> tuple[list[Body], float]:
    """Solver bodies of a case and the smallest cell at a contact [m]."""
    solids = [Solid(body, folder, _bonded_to(body.name, case.bonds)) for body in case.bodies]
    gravity = float(np.linalg.norm(case.gravity))
    cells = [resolution or s.predicted_cell(solids, gravity) for s in solids]
    finest = min(
        [c for s, c in zip(solids, cells, strict=True) if not s.rigid]
        or [min(s.smallest for s in solids) / RIGID_CELLS]
    )
    return [s.build(c, finest, solids, gravity) for s, c in zip(solids, cells, strict=True)], finest


class Solid:
    """One body of a case between its description and the solver's arrays."""

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
        self.given = None if self.primitive else given_mesh(folder / str(body.shape.mesh))
        self.outline = self.placed(self._outline())
        """Points of the surface that show where it is flat [m], shape (n, 3)."""
        if isinstance(self.primitive, Capsule):
            reach = 0.5 * self.primitive.length * np.abs(self.rotation[:, 2]) + self.primitive.radius
            ends = np.stack([self.position - reach, self.position + reach])
        else:
            ends = self.outline
        self.low: NDArray[np.float64] = ends.min(axis=0)
        self.high: NDArray[np.float64] = ends.max(axis=0)

    def _outline(self) -> NDArray[np.float64]:
        if self.primitive is None:
            return self._given().vertices
        if isinstance(self.primitive, Box):
            return (np.array(list(np.ndindex(2, 2, 2))) * 2.0 - 1.0) * self.primitive.half_extents
        return self.primitive.surface(float(self.primitive.half_extents.max()) / OUTLINE_EDGES).vertices

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
        """CELLS_PER_RADIUS in the predicted contact radius, at least four cells through the thickness."""
        alone = not self.may_touch(solids)
        thickness = self.smallest / CELLS_THROUGH
        return thickness if alone else min(self.predicted_radius(solids, gravity) / CELLS_PER_RADIUS, thickness)

    def predicted_radius(self, solids: "list[Solid]", gravity: float) -> float:
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

    def may_touch(self, solids: "list[Solid]") -> "list[Solid]":
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

    def build(self, cell: float, finest: float, solids: "list[Solid]", gravity: float) -> Body:
        """The solver's body."""
        planes = None if self.rigid else self._planes(cell, solids, gravity)
        if planes is not None:
            self._refuse_more_cells(planes, cell)
        surface = self._surface(planes, finest if planes is None else cell)
        sampled_side = float(self.extent.max()) + 2.0 * self._margin()
        spacing = max(min(finest / 2.5, self.smallest / 24.0), sampled_side / MOST_SAMPLES)
        distance = self._distance(surface, spacing)
        mass, center, inertia = self._mass_properties()
        m = self.material
        common = (
            self.body.name, self.fixed, surface.vertices, surface.faces,
            SignedDistance(distance.origin, distance.spacing, distance.values), mass, center, m.static_friction,
            m.dynamic_friction, m.rolling_resistance,
        )  # fmt: skip
        velocity, spin = np.asarray(self.body.velocity), np.asarray(self.body.angular_velocity)
        if planes is None:
            return RigidBody(*common, inertia, velocity=velocity, angular_velocity=spin)
        soft = self._soft(cell, planes, distance)
        soft = replace(soft, density=soft.density * (mass / float((soft.volume * soft.density).sum())))
        return SoftBody(*common, soft, velocity=velocity, angular_velocity=spin)

    def _refuse_more_cells(self, planes: Planes, cell: float) -> None:
        count = int(np.prod([len(p) - 1 for p in planes], dtype=np.float64))
        if count > MOST_CELLS:
            raise InputError(
                f"body {self.body.name!r}: {count:.3g} cells of {1e3 * cell:.2g} mm > {MOST_CELLS}; raise --resolution"
            )

    def _surface(self, planes: Planes | None, cell: float) -> Mesh:
        """As fine as the cells, so that a contact presses on every node under it."""
        if isinstance(self.primitive, Box) and planes is not None and np.allclose(self.rotation, np.eye(3)):
            local = self.primitive.surface_on([p - c for p, c in zip(planes, self.position, strict=True)])
        elif self.primitive is not None:
            local = self.primitive.surface(max(min(cell, self.smallest / 8.0), float(self.extent.max()) / 160.0))
        else:
            local = self._given()
        return Mesh.of(self.placed(local.vertices), local.faces)

    def _distance(self, surface: Mesh, spacing: float) -> DistanceGrid:
        margin = max(4.0 * spacing, self._margin())
        low, high = self.low - margin, self.high + margin
        if self.primitive is None:
            return distance_grid(surface, low, high, spacing)
        return sampled(self._exact_distance, low, high, spacing)

    def _margin(self) -> float:
        return min(0.5 * self.smallest, MOST_MARGIN)

    def _exact_distance(self, points: NDArray[np.float64]) -> NDArray[np.float64]:
        assert self.primitive is not None
        return self.primitive.distance((points - self.position) @ self.rotation)

    def _mass_properties(self) -> tuple[float, NDArray[np.float64], NDArray[np.float64]]:
        if self.primitive is not None:
            inertia = self.rotation @ np.diag(self.primitive.inertia_per_mass * self.mass) @ self.rotation.T
            return self.mass, self.position, inertia
        volume, center, unit = mass_properties(self._given(), 1.0)
        density = self.mass / volume
        return self.mass, self.placed(center[None])[0], self.rotation @ (unit * density) @ self.rotation.T

    def _soft(self, cell: float, planes: Planes, distance: DistanceGrid) -> Interior:
        position, volume = fill(planes, self._signed_distance(distance))
        one = np.ones(len(position))
        m = self.material
        loaded = (self.body.rest_shape or ("loaded" if self.fixed else "unloaded")) == "loaded"
        return Interior(
            position, volume, m.density * one, m.youngs_modulus * one, m.poisson_ratio * one, planes,
            self._held(planes), loaded,
        )  # fmt: skip

    def _signed_distance(self, grid: DistanceGrid) -> Distance:
        """Exact for primitives, interpolated for meshes."""
        return sampler(grid) if self.primitive is None else self._exact_distance

    def _planes(self, cell: float, solids: "list[Solid]", gravity: float) -> Planes:
        """Graded planes: fine where another body stands over or under this one."""
        reach = FINE_REACH * self.predicted_radius(solids, gravity)
        low, high = self.high.copy(), self.low.copy()
        for other in self.may_touch(solids):
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
        middle = 0.5 * (np.clip(other.position, self.low, self.high) + np.clip(self.position, other.low, other.high))
        return np.asarray(np.clip(middle, self.low, self.high))

    def _held(self, planes: Planes) -> NDArray[np.int8]:
        """Nodes of a fixed body within half a cell, measured across the face, of its clamped faces."""
        shape = tuple(len(p) for p in planes)
        state = np.full(shape, FREE, dtype=np.int8)
        if not self.fixed:
            return state
        local = (np.stack(np.meshgrid(*planes, indexing="ij"), axis=-1) - self.position) @ self.rotation
        size = np.stack(np.meshgrid(*(_spacing(p) for p in planes), indexing="ij"), axis=-1)
        box = self._local_box()
        for face in clamped_faces(self.body.clamp):
            axis, side = "xyz".index(face[0]), 0 if face.endswith("min") else 1
            across = size @ np.abs(self.rotation[:, axis])
            state[np.abs(local[..., axis] - box[side][axis]) <= 0.5 * across] = HELD
        return state

    def _local_box(self) -> NDArray[np.float64]:
        if self.primitive is not None:
            return np.stack([-self.primitive.half_extents, self.primitive.half_extents])
        return self._given().bounds


def _bonded_to(name: str, bonds: list[list[str]]) -> frozenset[str]:
    """Names of the bodies bonded to one."""
    return frozenset(one for bond in bonds if name in bond for one in bond if one != name)


def _spacing(planes: NDArray[np.float64]) -> NDArray[np.float64]:
    """Smaller of the two cells beside each plane [m], shape (n,)."""
    gap = np.diff(planes)
    return np.asarray(np.minimum(np.append(gap, np.inf), np.insert(gap, 0, np.inf)))


def given_mesh(path: Path) -> Mesh:
    """The mesh of a case, in metres as it is: no axis or unit is changed."""
    return read_scan(path, SourceOptions(up="z", unit="m"), Role.SCENE).mesh


def clamped_faces(clamp: str) -> list[str]:
    """Faces named by a clamp."""
    if clamp == "sides_and_bottom":
        return ["x_min", "x_max", "y_min", "y_max", "z_min"]
    return {"bottom": ["z_min"], "none": []}.get(clamp, [clamp])
