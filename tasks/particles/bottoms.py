"""How deep a soft base reaches under what is seen of it: down to what carries each part, or as thick as it is."""

from collections.abc import Mapping, Sequence

import numpy as np
from numpy.typing import NDArray

from dcap.geometry.solid.support import carried_bottoms
from dcap.scene.types.caution import Cause, Caution
from dcap.scene.types.mesh import Mesh
from tasks.particles.covers import Cover, lies_under, looks_up
from tasks.particles.drop_setup import DropSetup
from tasks.particles.layers import BaseLayers

Array = NDArray[np.float64]


def soft_bottoms(setup: DropSetup, layers: BaseLayers) -> Array:
    """Bottom of the soft solid under each face [m], shape (m,)."""
    boxes = [layers.base.parts[index].box for index in layers.soft]
    bottom = dict(zip(layers.soft, carried_bottoms(boxes).tolist(), strict=True))
    seen = set(layers.part.tolist())
    for index in layers.carrying:
        if index in seen:
            bottom[index] = thick_enough(setup, layers, index, bottom[index])
    # what carries a cover is no cover, so that covers can be seen to in any order
    carrying = {index: bottom[index] for index in layers.carrying}
    for index in seen & set(layers.covers):
        bottom[index] = cover_bottom(setup, layers, layers.covers[index], bottom[index], carrying)
    return np.array([bottom[index] for index in layers.part.tolist()])


def thick_enough(setup: DropSetup, layers: BaseLayers, index: int, bottom: float) -> float:
    """Bottom of a part that is no cover [m]; one that is seen as a sheet only gets a thickness."""
    least = setup.config.least_thickness
    top = float(np.median(layers.mesh.triangles[layers.part == index][:, :, 2]))
    if top - bottom >= least:
        return bottom
    taken = (
        f"{layers.base.id}: {layers.base.parts[index].name} shows no thickness and is taken as {least} m thick "
        "(ParticlesConfig.least_thickness)"
    )
    setup.notes.append(Caution(Cause.ASSUMED, taken))
    return top - least


def cover_bottom(
    setup: DropSetup, layers: BaseLayers, cover: Cover, own: float, carrying: Mapping[int, float]
) -> float:
    """Bottom under a cover [m]: over something soft where that or the cover itself ends, else as deep as the cover and
    those beneath it are thick, where the object may touch it below its lowest place."""
    under = [bottom for index, bottom in carrying.items() if lies_under(layers.base, index, cover)]
    if under:
        return min([own, *under])
    depth = sum(layers.covers[index].thickness for index in (cover.part, *layers.beneath[cover.part]))
    return lowest_top(layers.mesh, layers.part == cover.part, setup) - depth


def lowest_top(mesh: Mesh, own: NDArray[np.bool_], setup: DropSetup) -> float:
    """Lowest place of a cover's faces (m,) that look up where the object may touch it [m]: there a wavy cloth lies on
    what carries it. Of all that look up if none is there, of all if none looks up."""
    upward = own & looks_up(mesh)
    choices: Sequence[NDArray[np.bool_]] = (upward & setup.in_contact_region(mesh.triangles), upward, own)
    chosen = next(faces for faces in choices if faces.any())
    return float(mesh.triangles[chosen][:, :, 2].min())
