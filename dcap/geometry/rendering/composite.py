"""The object put into a photograph: its own colours where it is seen, its shadow on the rest.

In: conditioning maps of the photograph's camera and the photograph. Out: a picture of the same size. The photograph is
darkened in linear light by what the object takes away of it; what hides the object stays before it.
"""

import numpy as np
from numpy.typing import NDArray

from dcap.scene.errors import InputError
from dcap.scene.srgb import linear_from_srgb
from dcap.scene.types.maps import ConditioningMaps

Bytes = NDArray[np.uint8]


def composite(maps: ConditioningMaps, photo: Bytes) -> Bytes:
    """The photograph (h, w, 3) with the object in it; InputError if it is not of the maps' size."""
    if photo.shape != maps.rgb.shape:
        (height, width), (h, w) = maps.rgb.shape[:2], photo.shape[:2]
        raise InputError(
            f"the photo has {w} x {h} pixels and its camera {width} x {height}; give the photo's own camera"
        )
    share = maps.object_mask[..., None] / 255.0
    ground = encoded(linear_from_srgb(photo) * maps.shadow[..., None])
    return np.asarray(np.round(ground * (1.0 - share) + maps.object_rgb * share), dtype=np.uint8)


def encoded(linear: NDArray[np.float64]) -> NDArray[np.float64]:
    """sRGB 0..255 of linear light."""
    return 255.0 * np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * np.power(linear, 1 / 2.4) - 0.055)
