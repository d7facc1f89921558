"""Conditioning maps: one camera's view of a settled placement, a value for each pixel."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

F32 = NDArray[np.float32]
Bytes = NDArray[np.uint8]
Numbers = NDArray[np.uint16]

SEEN_CONTACT, HIDDEN_CONTACT = 255, 128
"""Values of the contact map: visible patch, and patch hidden by the object."""


@dataclass(frozen=True, eq=False, slots=True)
class ConditioningMaps:
    """All passes of one view, pixel by pixel of the same rays; h rows, w columns."""

    rgb: Bytes
    """sRGB with the object at rest, shape (h, w, 3)."""
    object_rgb: Bytes
    """sRGB of the object's own share of each pixel, black elsewhere, shape (h, w, 3)."""
    depth: F32
    """Along the optical axis [m], inf where nothing is, shape (h, w)."""
    normal_world: F32
    """Unit shading normals towards the viewer, z up; zeros where nothing is, shape (h, w, 3)."""
    normal_camera: F32
    """The same with x to the right, y down, z forward, shape (h, w, 3)."""
    object_mask: Bytes
    """Share of each pixel that the object covers, 0..255, shape (h, w)."""
    hidden_mask: Bytes
    """Share of each pixel in which something hides the object, 0..255, shape (h, w)."""
    contact: Bytes
    """SEEN_CONTACT at surface in or next to the contact patch, HIDDEN_CONTACT where the object hides the patch, 0
    elsewhere, shape (h, w)."""
    shadow: F32
    """Light on the scene with the object over that without it, luminance 0..1; on the object that of the
    nearest pixel outside it, shape (h, w)."""
    ambient_occlusion: F32
    """Share of the sky that reaches the surface, 0..1; 1 where nothing is, shape (h, w)."""
    dent: F32
    """Displacement of the support along its outward normal, negative inwards; 0 elsewhere [m], shape (h, w)."""
    instance: Numbers
    """Ids, 0 where nothing is, shape (h, w)."""
    part: Numbers
    material: Numbers
    names: dict[str, dict[str, str]]
    """Names of the ids: `instance`, `part` and `material`, each from id to name."""
