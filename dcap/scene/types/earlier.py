"""Knowledge of a scene with earlier placed things: their masses, their supports, their dents."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dcap.scene.types.arrays import check_array
from dcap.scene.types.choices import Anchor
from dcap.scene.types.materials import PartMaterial
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.segmentation import Instance, Segmentation


@dataclass(frozen=True, slots=True)
class PlacedThing:
    """A thing from an earlier placement, which may move again."""

    id: str
    """Its instance: placed_1, placed_2 ..."""
    mass: float
    """[kg]."""
    carried_by: tuple[str, ...]
    """Ids of the instances that it rests on, the one with the largest load first."""
    prompt: str = ""
    """The sentence of its placement."""


@dataclass(frozen=True, eq=False, slots=True)
class Deformation:
    """Difference of an instance from its unloaded shape: the dent under a ball, a sagging cushion."""

    instance: str
    loads: tuple[str, ...]
    """Ids of the placed things that cause it; a soft placed thing is among its own loads."""
    surface: Mesh
    """Deformed piece of the instance's surface, under its loads."""
    shift: NDArray[np.float64]
    """Displacement of its vertices from their unloaded positions [m], shape (n, 3)."""

    def __post_init__(self) -> None:
        check_array(f"shift of the deformation of {self.instance}", self.shift, len(self.surface.vertices), 3)


@dataclass(frozen=True, eq=False, slots=True)
class EarlierPlacements:
    """Facts of the scene in the folder of a placement."""

    instances: tuple[Instance, ...]
    """Everything in the scene, the placed things last, in the order in which they were placed."""
    materials: tuple[PartMaterial, ...]
    """Materials chosen earlier; `body` is an instance's id."""
    placed: tuple[PlacedThing, ...]
    touching: tuple[tuple[str, str], ...]
    """Pairs of instances that touched at rest, one of each pair being a placed thing."""
    deformations: tuple[Deformation, ...]

    def thing(self, instance_id: str) -> PlacedThing | None:
        """The placed thing with this id; None for other instances."""
        return next((one for one in self.placed if one.id == instance_id), None)

    def ground_of(self, instance_id: str) -> str:
        """The instance that finally carries a thing: for a cup on a book on a bed, the bed."""
        seen: list[str] = []
        while (thing := self.thing(instance_id)) is not None and thing.carried_by and instance_id not in seen:
            seen.append(instance_id)
            instance_id = thing.carried_by[0]
        return instance_id


@dataclass(frozen=True, eq=False, slots=True)
class FreedThings:
    """The start of a drop in which earlier placed things take part as free bodies."""

    scene: Segmentation
    """The scene without the dents of those things, which are lifted out of them."""
    anchor: Anchor
    """The object's start above them."""
    things: tuple[PlacedThing, ...]
    """The things that take part, as they lie on each other from the bottom up."""
    ground: str
    """Id of the instance that finally carries the object: the anchor's base, unless that is one of the things."""
    materials: tuple[PartMaterial, ...]
    """Materials chosen earlier."""
    notes: tuple[str, ...]
