"""One value of each type that speaks of earlier placements, for tests of what is stored."""

import numpy as np

from dcap.scene.types.choices import Anchor
from dcap.scene.types.earlier import Deformation, EarlierPlacements, FreedThings, PlacedThing
from dcap.scene.types.materials import BodyModel, Material, PartMaterial
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.segmentation import Instance, Segmentation


def chained(instance: Instance, anchor: Anchor, material: Material, mesh: Mesh) -> list[object]:
    """A ball was placed on an instance, whose surface is a mesh of some material."""
    row = PartMaterial(instance.id, "mattress", 0, material, BodyModel.MPM, "a mattress")
    thing = PlacedThing("placed_1", 0.3, (instance.id,), "put the ball on the bed")
    dent = Deformation(instance.id, ("placed_1",), mesh, 0.1 * mesh.vertices)
    owner = np.zeros(len(mesh.faces), np.int32)
    return [
        thing,
        dent,
        EarlierPlacements((instance,), (row,), (thing,), ((instance.id, "placed_1"),), (dent,)),
        FreedThings(
            Segmentation(mesh, (instance,), owner, owner), anchor, (thing,), instance.id, (row,), ("it is free",)
        ),
    ]
