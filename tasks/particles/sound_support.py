"""The solid of what carries or stands around: from the faces as they are while those make one, else from what is seen.

In: the faces of a fixed body near the object and a bottom height for each. Out: its signed distance, the faces that
contact and pictures of dents use, and a report. Scans that make no sound solid (holes, second layers, sheets inside,
missing sides) get the solid under what the object sees of them.
"""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dcap.geometry.distance import MeshDistance
from dcap.geometry.pieces import is_soup
from dcap.geometry.solid.closed import RepairLimits
from dcap.geometry.solid.columns import ColumnSolid, column_solid
from dcap.geometry.solid.repair_log import RepairLog
from dcap.geometry.solid.support import ready_support
from dcap.scene.types.mesh import Mesh
from tasks.particles.drop_setup import DropSetup

Array = NDArray[np.float64]

TOLERANCE = RepairLimits().tolerance
BEYOND = 0.03  # the solid under what is seen reaches this far beyond the crop [m]: what goes on there is cut


@dataclass(frozen=True, eq=False, slots=True)
class SoundSupport:
    """A fixed body near the object."""

    solid: MeshDistance
    mesh: Mesh
    """Its faces."""
    part: NDArray[np.int32]
    """The part that each belongs to, shape (m,)."""
    bottom: Array
    """Height down to which each is solid [m], shape (m,)."""


def sound_support(
    setup: DropSetup, body: str, names: list[str], mesh: Mesh, part: NDArray[np.int32], bottom: Array, *, torn: bool
) -> SoundSupport:
    """The solid under faces, each of a `part` and down to its own `bottom` [m]; `names` are those of its parts.

    `torn`: a hole was closed where the object goes, so that faces lie over one another there. Then, and where no two
    faces hang together, what is seen is asked first.
    """
    if torn or is_soup(mesh):
        seen = under_what_is_seen(setup, mesh, bottom)
        if seen is not None:
            return kept_seen(setup, body, names, seen, part, bottom)
    solid, report = ready_support(mesh, bottom, setup.contact_region, setup.config.hole_perimeter)
    if report.problem:
        seen = under_what_is_seen(setup, mesh, bottom)
        if seen is not None and (not seen.report.problem or seen.report.hausdorff < report.hausdorff):
            return kept_seen(setup, body, names, seen, part, bottom)
    setup.note_geometry(body, names, report)
    return SoundSupport(solid, mesh, part, bottom)


def kept_seen(
    setup: DropSetup, body: str, names: list[str], seen: ColumnSolid, part: NDArray[np.int32], bottom: Array
) -> SoundSupport:
    """The solid under what is seen, with what is seen as its faces."""
    setup.note_geometry(body, names, seen.report)
    top = np.flatnonzero(seen.top)
    source = seen.source[top]
    return SoundSupport(MeshDistance(seen.mesh), seen.mesh.submesh(top), part[source], bottom[source])


def under_what_is_seen(setup: DropSetup, mesh: Mesh, bottom: Array) -> ColumnSolid | None:
    """The solid under what the object sees of the faces; None if it sees none."""
    region = setup.contact_region
    region[0, :2] -= BEYOND
    region[1, :2] += BEYOND
    return column_solid(mesh, bottom, region, setup.mesh, TOLERANCE, RepairLog())
