"""Drawings by Matplotlib as pictures."""

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

if TYPE_CHECKING:
    from matplotlib.backends.backend_agg import FigureCanvasAgg


def drawing(canvas: "FigureCanvasAgg") -> NDArray[np.uint8]:
    """Content of a canvas as a picture, shape (h, w, 3)."""
    canvas.draw()  # type: ignore[no-untyped-call]
    return np.asarray(canvas.buffer_rgba())[..., :3].copy()  # type: ignore[no-untyped-call]
