"""Repairs of a surface so that it encloses a solid, and the displacement of its visible faces by them."""

from dataclasses import dataclass
from enum import StrEnum


class Method(StrEnum):
    """Surfaces from which distances are computed."""

    CLOSED = "closed surface"
    """The given faces and those that close them."""
    WINDING = "faces, inside by winding number"
    """The given faces and, for a support, the columns under them: not a clean surface; sides are determined by
    counting."""
    COLUMNS = "columns under what is seen"
    """A closed surface of the faces visible from the descending object, and the columns under them."""
    REMESHED = "remeshed"
    """A surface meshed again from a sampled distance."""


@dataclass(frozen=True, slots=True)
class RepairReport:
    """One surface; lengths in metres."""

    method: Method
    """Surface from which distances are computed; `closed` and `agreement` are weaker for faces with winding numbers."""
    closed: bool
    """Whether every directed edge has its opposite; for a closed or meshed surface also whether no face is empty or
    duplicated, and it is wound outwards.
    """
    agreement: float
    """Share of points in and around the solid whose side is certain [-]: for a closed or meshed surface those whose
    winding number and ray parity agree; else those whose winding number is within 0.1 of a whole number.
    """
    hausdorff: float
    """Largest distance from the visible surface to the repaired one [m]."""
    mean: float
    """Mean of that distance over the visible surface [m]."""
    tolerance: float
    """Upper bound that `hausdorff` had to meet [m]."""
    spacing: float
    """Mean spacing of the points where it was measured, besides all vertices [m]."""
    volume: float
    """Enclosed volume [m^3]."""
    resolution: float
    """Cell of the remesh [m]; 0: the given faces were kept."""
    repairs: tuple[str, ...]
    """Repairs, one sentence each; empty: none."""
    problem: str
    """Why the surface is not a good solid; empty if it is."""
    region: tuple[float, ...] = ()
    """Lower and upper corner of the box in which `hausdorff` and `mean` were measured [m], six; empty: everywhere."""


@dataclass(frozen=True, slots=True)
class BodyGeometry:
    """The report of one piece of one body of the drop."""

    body: str
    """Name of the simulated body."""
    part: str
    """Name of its part or parts."""
    report: RepairReport
