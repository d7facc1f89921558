"""Drawings by Matplotlib as pictures."""

import numpy as np
from matplotlib.backends.backend_agg import FigureCanvasAgg
from numpy.typing import NDArray


def drawing(canvas: FigureCanvasAgg) -> NDArray[np.uint8]:
    """What is on a canvas, shape (h, w, 3)."""
    canvas.draw()  # type: ignore[no-untyped-call]
    return np.asarray(canvas.buffer_rgba())[..., :3].copy()  # type: ignore[no-untyped-call]
