"""Judges a rest state: its motion in one second of MuJoCo, and its overlap by Open3D's distances.

In: the final triangles of an object and of the scene around it (world frame, z up, metres), the object's mass and the
friction of each pair. Out: a `RestVerdict`. Everything is rigid, dents included, and the same for every method. Neither
the solver nor the contact model of the drop takes part.

`judge_rest` may be called with plain arrays:

    scene = Surroundings.of([Mesh.of(vertices, faces), ...], friction=[0.5, ...])
    verdict = judge_rest(Mesh.of(vertices, faces), scene, mass=1.2)
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dcap.arrays import Array
from dcap.evaluation.referee.onward import simulate
from dcap.evaluation.referee.overlap import overlap_depth
from dcap.evaluation.referee.prisms import object_prisms, scene_prisms
from dcap.geometry.solid.repair import mass_properties
from dcap.scene.errors import GeometryError, InputError
from dcap.scene.types.arrays import check_array
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.particles import InertialProperties

SECONDS = 1.0
"""Simulated time [s]."""


@dataclass(frozen=True, eq=False, slots=True)
class Surroundings:
    """The scene that an object rests in, in its final state."""

    mesh: Mesh
    """All of it, wound outwards."""
    owner: NDArray[np.int64]
    """Thing of each face, an index of `friction`, shape (m,)."""
    friction: Array
    """Friction between the object and each thing: sliding [-] and rolling resistance [m], shape (k, 2)."""

    def __post_init__(self) -> None:
        check_array("owner of the surroundings", self.owner, len(self.mesh.faces))
        check_array("friction of the surroundings", self.friction, None, 2)
        if len(self.owner) and not 0 <= self.owner.min() <= self.owner.max() < len(self.friction):
            raise InputError(f"owners {self.owner.min()}..{self.owner.max()} outside 0..{len(self.friction) - 1}")

    @classmethod
    def of(cls, things: Sequence[Mesh], friction: float | Sequence[float]) -> "Surroundings":
        """The surroundings of one mesh for each thing, with the sliding friction of all pairs or of each [-]."""
        sliding = np.broadcast_to(np.asarray(friction, dtype=np.float64), len(things))
        owner = np.repeat(np.arange(len(things)), [len(one.faces) for one in things])
        return cls(Mesh.concatenate(list(things)), owner, np.column_stack([sliding, np.zeros(len(things))]))


@dataclass(frozen=True, eq=False, slots=True)
class RestVerdict:
    """The referee's verdict on a rest state."""

    seconds: float
    """Simulated time [s]."""
    drift_m: float
    """Largest distance of the centre of mass from its start [m]."""
    drift_deg: float
    """Largest turn from the start [degrees]."""
    carried: Array
    """Share of the weight that each thing carries in the last tenth of the second [-], shape (k,); negative if it
    presses from above."""
    penetration_m: float
    """Overlap of object and scene at the start, by Open3D's distances [m]."""
    deviation_m: float
    """Largest distance of the collision shapes from the surfaces near the contact [m]."""

    @property
    def supported(self) -> bool:
        """Whether the scene carries the object at the end; else it falls."""
        return bool(self.carried.sum() >= CARRIED)

    @property
    def carrier(self) -> int:
        """Index of the thing that carries most at the end; -1 if nothing does."""
        return int(self.carried.argmax()) if self.supported else -1


CARRIED = 0.5
"""Least share of the weight that a support carries [-]: halfway between a fall and rest."""


def judge_rest(
    thing: Mesh,
    scene: Surroundings,
    mass: float | None = None,
    center_of_mass: Array | None = None,
    *,
    inertial: InertialProperties | None = None,
    seconds: float = SECONDS,
) -> RestVerdict:
    """Judge a rest state; InputError without MuJoCo, GeometryError where the object encloses nothing.

    Args:
        thing: the object's final surface.
        scene: its surroundings in their final state. Parts out of reach within the time may be missing.
        mass: of the object [kg], of one density.
        center_of_mass: if it is not that of one density [m], shape (3,).
        inertial: mass, centre of mass and inertia about it in the world, if known; instead of the two.
        seconds: simulated time [s].
    """
    if inertial is None:
        if mass is None:
            raise InputError("the referee needs the mass of the object, or its inertia")
        whole, center, inertia = mass_properties(thing, 1.0)
        center = center if center_of_mass is None else np.asarray(center_of_mass, dtype=np.float64)
        inertial = InertialProperties(mass, center, inertia * (mass / whole))
    if not inertial.mass > 0.0:
        raise GeometryError(f"the object's mass is {inertial.mass} kg, expected more than 0")
    fixed, free = scene_prisms(scene.mesh, scene.owner, thing), object_prisms(thing, scene.mesh)
    motion = simulate(fixed, scene.friction, free, inertial, seconds)
    return RestVerdict(
        seconds=seconds,
        drift_m=motion.drift_m,
        drift_deg=motion.drift_deg,
        carried=motion.carried,
        penetration_m=overlap_depth(thing, scene.mesh, scene.owner),
        deviation_m=max(fixed.deviation, free.deviation),
    )
