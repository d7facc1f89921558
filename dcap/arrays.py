"""Short names for numpy arrays by element type."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Float32Array = NDArray[np.float32]
IntArray = NDArray[np.int64]
Mask = NDArray[np.bool_]
ByteArray = NDArray[np.uint8]
