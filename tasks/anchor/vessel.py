"""Warns if an object that should go into a vessel stays on its rim.

In: the sentence, the start and the vessel's part. Out: a caution where the start is held up over the bottom and the
object's centre of mass is above the rim: an object that stands in a vessel reaches its bottom, and one
that is wedged in it has its centre below the rim.
"""

import numpy as np
from numpy.typing import NDArray

from dcap.geometry.placement.clearance import Start
from dcap.language.offline.placing import placing_of
from dcap.language.offline.sentence import read
from dcap.scene.errors import LanguageError
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.outcome import Cause, Caution
from dcap.scene.types.segmentation import Instance, Part

HELD_UP = 0.01
"""Clearance above the surface below, beyond which something else must hold the object up [m]."""


def rim_cautions(
    prompt: str, base: Instance, part: Part, start: Start, below: NDArray[np.float64], mesh: Mesh
) -> tuple[Caution, ...]:
    """The caution; none where the sentence puts nothing into a vessel, or the object gets into it.

    Args:
        prompt: the sentence.
        base: the vessel.
        part: the part over which the object starts.
        start: where it starts.
        below: the surface under the object's centre of mass [m], shape (3,).
        mesh: the object, its centre of mass at the origin [m].
    """
    lowest = start.height + float(mesh.bounds[0, 2])
    held_up = lowest - below[2] > start.gap + HELD_UP
    if base.structure or not (held_up and start.height > part.box.top and goes_in(prompt)):
        return ()
    size = np.ptp(mesh.bounds, axis=0)
    text = f"{size[0]:.2f} x {size[1]:.2f} m do not fit into the {base.label}; the object is set on the rim"
    return (Caution(Cause.NOT_MET, text),)


def goes_in(prompt: str) -> bool:
    """Whether the sentence puts the object into something."""
    try:
        return placing_of(read(prompt)).relation == "in"
    except LanguageError:
        return False
