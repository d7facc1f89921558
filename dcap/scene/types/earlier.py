"""Knowledge of a scene with things placed earlier: their masses, their supports, their dents."""

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
    """Id of its instance: placed_1, placed_2 ..."""
    mass: float
    """Mass [kg]."""
    carried_by: tuple[str, ...]
    """Ids of the instances on which it rests, the one with the largest load first."""
    prompt: str = ""
    """The sentence of its placement."""


@dataclass(frozen=True, eq=False, slots=True)
class Deformation:
    """Difference of an instance from its unloaded shape: the dent under a ball, a sagging cushion."""

    instance: str
    loads: tuple[str, ...]
    """Ids of the placed things that cause it; a soft placed thing is one of its own loads."""
    surface: Mesh
    """Deformed piece of the instance's surface under its loads."""
    shift: NDArray[np.float64]
    """Displacements of its vertices from their unloaded positions [m], shape (n, 3)."""

    def __post_init__(self) -> None:
        check_array(f"shift of the deformation of {self.instance}", self.shift, len(self.surface.vertices), 3)


@dataclass(frozen=True, eq=False, slots=True)
class EarlierPlacements:
    """Facts about the scene from a placement's folder."""

    instances: tuple[Instance, ...]
    """All instances of the scene, with the placed things last, in order of placement."""
    materials: tuple[PartMaterial, ...]
    """Materials chosen earlier; `body` is the id of an instance."""
    placed: tuple[PlacedThing, ...]
    touching: tuple[tuple[str, str], ...]
    """Pairs of instances that touched at rest, at least one of them a placed thing."""
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
    """The start of a drop in which things placed earlier take part as free bodies."""

    scene: Segmentation
    """The scene without the dents of these things, which are lifted out of them."""
    anchor: Anchor
    """The object's start above them."""
    things: tuple[PlacedThing, ...]
    """The things that take part, from the bottom up."""
    ground: str
    """Id of the instance that finally carries the object: the anchor's base, unless that is one of the things."""
    materials: tuple[PartMaterial, ...]
    """Materials chosen earlier."""
    notes: tuple[str, ...]
