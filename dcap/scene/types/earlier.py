"""What is known of a scene in which things were placed before: what they weigh, what they rest on, what they dented."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dcap.scene.types.anchor import Anchor
from dcap.scene.types.arrays import check_array
from dcap.scene.types.materials import PartMaterial
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.segmentation import Instance, Segmentation


@dataclass(frozen=True, slots=True)
class PlacedThing:
    """A thing that an earlier placement has put there: it may move again."""

    id: str
    """Its instance: placed_1, placed_2 ..."""
    mass: float
    """[kg]."""
    carried_by: tuple[str, ...]
    """Ids of the instances that it rests on, the one that carries most of it first."""
    prompt: str = ""
    """The sentence that it was placed with."""


@dataclass(frozen=True, eq=False, slots=True)
class Deformation:
    """How an instance differs from its unloaded shape: the dent under a ball, a cushion that has sagged."""

    instance: str
    loads: tuple[str, ...]
    """Ids of the placed things that cause it; a soft thing that was placed is among its own."""
    surface: Mesh
    """That piece of the instance's surface, as it is under its loads."""
    shift: NDArray[np.float64]
    """How far its vertices have moved from where they are unloaded [m], shape (n, 3)."""

    def __post_init__(self) -> None:
        check_array(f"shift of the deformation of {self.instance}", self.shift, len(self.surface.vertices), 3)


@dataclass(frozen=True, eq=False, slots=True)
class EarlierPlacements:
    """What the folder of a placement says of its scene."""

    instances: tuple[Instance, ...]
    """Everything in the scene, the placed things last, in the order in which they were placed."""
    materials: tuple[PartMaterial, ...]
    """Materials that were chosen before; `body` is an instance's id."""
    placed: tuple[PlacedThing, ...]
    touching: tuple[tuple[str, str], ...]
    """Pairs of instances that touched at rest, one of each a placed thing."""
    deformations: tuple[Deformation, ...]

    def thing(self, instance_id: str) -> PlacedThing | None:
        """The placed thing with this id; None where it is no placed thing."""
        return next((one for one in self.placed if one.id == instance_id), None)

    def ground_of(self, instance_id: str) -> str:
        """The instance that in the end carries something: of a cup on a book on a bed the bed."""
        seen: list[str] = []
        while (thing := self.thing(instance_id)) is not None and thing.carried_by and instance_id not in seen:
            seen.append(instance_id)
            instance_id = thing.carried_by[0]
        return instance_id


@dataclass(frozen=True, eq=False, slots=True)
class FreedThings:
    """The start of a drop in which things that were placed before take part as free bodies."""

    scene: Segmentation
    """What those things dented is in its unloaded shape, and they are lifted out of it."""
    anchor: Anchor
    """The object's start above that."""
    things: tuple[PlacedThing, ...]
    """The things that take part, as they lie on each other from the bottom up."""
    ground: str
    """Id of the instance that in the end carries the object; the same as the anchor's base unless that is one of the
    things."""
    materials: tuple[PartMaterial, ...]
    """Materials that were chosen before."""
    notes: tuple[str, ...]
