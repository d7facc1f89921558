"""A proposed pose as a final state: the object in the method's pose, the scene unchanged.

In: the object and the proposed pose. Out: `Settled` with verdict `as_posed`, without contacts and certificate.
"""

import numpy as np

from dcap.scene.types.choices import Anchor
from dcap.scene.types.segmentation import SegmentedObject
from dcap.scene.types.settled import Settled, SettledBody
from solver.certificate import History, Verdict
from tasks.cache import stage

OBJECT = "object"


def posed(item: SegmentedObject, anchor: Anchor) -> Settled:
    """Return the proposed pose unchanged as the final state."""
    surface = item.mesh.transformed(anchor.world_from_object)
    still = SettledBody(
        OBJECT, surface, np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]), np.zeros_like(surface.vertices)
    )  # fmt: skip
    none, counts = np.zeros(0), np.zeros(0, dtype=np.int64)
    history = History(none, none, none, none, none, none, counts, counts)
    return Settled(Verdict.AS_POSED, (still,), (), np.zeros((0, 3)), None, history, 0, 0.0, ())


posed_task = stage(posed)
