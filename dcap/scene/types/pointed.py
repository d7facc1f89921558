"""Target of a person's pointing in a scene: the thing, the place on it, and faces that become a separate thing."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dcap.scene.types.arrays import check_array


@dataclass(frozen=True, eq=False, slots=True)
class Pointed:
    """A point on a thing, or a region that carries."""

    base_id: str
    """Id of the thing; that of a new one if faces are cut out."""
    label: str
    """Its name from now on."""
    part: str
    """Name of its one part if faces are cut out, else empty: parts stay or are found by its label."""
    point: NDArray[np.float64]
    """The place on its surface [m], shape (3,), or (0,) if a region was given."""
    cut: NDArray[np.int64]
    """Faces that become the thing, as runs, first and one past the last, shape (k, 2); none: it is not changed."""
    renamed: bool
    """Whether the existing thing gets the label, and its parts are segmented again."""
    notes: tuple[str, ...]

    def __post_init__(self) -> None:
        check_array("point", self.point, None)
        check_array("cut", self.cut, None, 2)
