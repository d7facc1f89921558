"""How light meets surfaces: a key light, a bright sky, a little fill from the camera, and what a screen makes of it.

All colours are linear light; 1 is a white surface that faces the key light. Components come first: (3, n).
"""

import numpy as np
from numpy.typing import NDArray

from dcap.geometry.rendering.surface import SurfaceHits, dot

Array = NDArray[np.float32]


def column(*values: float) -> Array:
    """A colour for use with arrays that have the components first, shape (3, 1)."""
    return np.array(values, dtype=np.float32)[:, None]


KEY_COLOR = column(1.00, 0.965, 0.91) * 0.74
SKY_COLOR = column(0.92, 0.96, 1.00) * 0.50
GROUND_COLOR = column(1.00, 0.95, 0.88) * 0.26
FILL_COLOR = column(0.95, 0.97, 1.00) * 0.12
BACKDROP_LOW, BACKDROP_HIGH = column(0.66, 0.65, 0.64), column(0.83, 0.87, 0.92)
SHEEN = 0.035  # a broad, weak highlight: enough to read a curved surface, too little to look like plastic
GRAZING = 0.12  # cosine of the angle of incidence below which the key light fades faster than Lambert's law
KNEE = 0.75  # linear brightness above which a soft shoulder replaces clipping


def shade(surface: SurfaceHits, light: Array, key: NDArray[np.float64]) -> Array:
    """Linear colours of what rays met, (3, n); light (2, n): shares of the key light and of the sky that reach it."""
    normal, toward = surface.smooth, key.astype(np.float32)[:, None]
    facing = np.clip(dot(normal, toward), 0.0, 1.0)
    # fades in gently: at grazing light the noise of a scan would flicker, and facets would show at the terminator
    lambert = facing * facing * (1.0 + GRAZING) / (facing + GRAZING)
    headlight = np.clip(-dot(normal, surface.direction), 0.0, 1.0)
    ambient = GROUND_COLOR + (SKY_COLOR - GROUND_COLOR) * (0.5 + 0.5 * normal[2]) + FILL_COLOR * headlight
    total = surface.color * (KEY_COLOR * (lambert * light[0]) + ambient * light[1])
    half = toward - surface.direction
    gloss = np.clip(dot(normal, half) / np.sqrt(dot(half, half)), 0.0, 1.0)
    for _ in range(3):
        gloss = gloss * gloss
    gloss = gloss * gloss * gloss  # the 24th power
    total += SHEEN * gloss * light[0]
    return np.asarray(np.where(surface.mesh_index >= 0, total, background(surface.direction)))


def background(direction: Array) -> Array:
    """A soft studio backdrop: light grey below, a cooler white above, shape (3, n)."""
    height = np.clip(0.5 + 0.9 * direction[2], 0.0, 1.0)
    return np.asarray(BACKDROP_LOW + (BACKDROP_HIGH - BACKDROP_LOW) * (height * height * (3.0 - 2.0 * height)))


def compressed(linear: Array) -> Array:
    """Displayed brightness 0..1 of linear light: a soft shoulder above the knee, then the sRGB curve."""
    over = np.maximum(linear - KNEE, 0.0)
    toned = np.minimum(linear, KNEE) + (1 - KNEE) * (1 - np.exp(-over / (1 - KNEE)))
    curved = 1.055 * np.power(np.maximum(toned, 1e-9), 1 / 2.4) - 0.055
    return np.asarray(np.where(toned <= 0.0031308, 12.92 * toned, curved))
