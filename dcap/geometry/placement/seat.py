"""Whether a figure sits by its shape: on its body, or stands on legs.

In: a mesh and its own up. Out: whether it has legs, that is, more air than body right under its centre of mass; and
whether it sits: has none under it, and that centre nearer to its bottom than to its top, since legs are lighter than
what they carry.
"""

import numpy as np
from numpy.typing import NDArray

from dcap.geometry.placement.poses import center_of_mass, turn_between
from dcap.geometry.placement.upright import used_vertices
from dcap.geometry.raycast import Raycaster
from dcap.scene.types.mesh import Mesh

Array = NDArray[np.float64]

LOOKS = 9
"""Looks from below along each side of a square about the centre of mass [-]."""
ABOUT = 0.1
"""Half of that square's side over the larger horizontal extent [-]: a crease or a tail between them is passed by."""
MOST = 0.5
"""Share of the height of the centre of mass, and of that of the thing: of air below the centre, and of the centre [-].
Half is where there is as much air as body, and as much above as below."""


def sits(mesh: Mesh, up: Array) -> bool:
    """Whether a mesh with its own up, a unit vector of shape (3,), sits."""
    height = used_vertices(mesh) @ up
    low, middle = float(height.min()), float(center_of_mass(mesh) @ up)
    return middle - low <= MOST * (float(height.max()) - low) and not on_legs(mesh, up)


def on_legs(mesh: Mesh, up: Array) -> bool:
    """Whether a mesh with its own up, a unit vector of shape (3,), has more air than body under its centre of mass."""
    turn = turn_between(up, np.array([0.0, 0.0, 1.0]))
    points, center = used_vertices(mesh) @ turn.T, turn @ center_of_mass(mesh)
    low, high = points.min(axis=0), points.max(axis=0)
    height = float(center[2] - low[2])
    steps = ABOUT * float((high - low)[:2].max()) * np.linspace(-1.0, 1.0, LOOKS)
    x, y = (grid.ravel() for grid in np.meshgrid(center[0] + steps, center[1] + steps))
    origin = np.c_[x, y, np.full(len(x), low[2] - height)]
    hits = Raycaster(mesh).cast(origin @ turn, np.tile(up, (len(origin), 1)))
    air = np.where(hits.face >= 0, hits.distance - height, np.inf)
    return bool(np.median(air) > MOST * height)
