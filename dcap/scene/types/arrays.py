"""Checks of a dataclass's arrays, shape and range, once at construction."""

import numpy as np
from numpy.typing import NDArray

from dcap.scene.errors import GeometryError


def check_array(name: str, array: NDArray[np.generic], *shape: int | None) -> None:
    """Raise an error for a wrong shape (None: any length) or numbers that are not finite."""
    if array.ndim != len(shape) or any(want not in (None, have) for want, have in zip(shape, array.shape, strict=True)):
        expected = ", ".join("n" if one is None else str(one) for one in shape)
        raise GeometryError(f"{name} has shape {array.shape}, expected ({expected})")
    finite = np.isfinite(array)
    if not finite.all():
        raise GeometryError(f"{name} holds {array[~finite].flat[0]}, expected finite numbers")


def check_index(name: str, array: NDArray[np.integer], *, length: int, count: int) -> None:
    """Raise an error for a wrong length or an index outside -1 (none) to `count` - 1."""
    check_array(name, array, length)
    if length and (array.min() < -1 or array.max() >= count):
        raise GeometryError(f"{name} spans {array.min()} to {array.max()}, expected -1 to {count - 1}")
