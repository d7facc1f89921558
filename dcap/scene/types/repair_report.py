"""What was repaired on a surface so that it encloses a solid, and how far that moved what can be seen."""

from dataclasses import dataclass
from enum import StrEnum


class Method(StrEnum):
    """What distances are read from."""

    CLOSED = "closed surface"
    """The given faces and those that close them."""
    WINDING = "faces, inside by winding number"
    """The given faces and, for a support, what lies under them: no clean surface, its sides are told by counting."""
    COLUMNS = "columns under what is seen"
    """A closed surface of what is seen from where the object comes down, and what lies under it."""
    REMESHED = "remeshed"
    """A surface meshed again from a sampled distance."""


@dataclass(frozen=True, slots=True)
class RepairReport:
    """One surface; lengths in metres."""

    method: Method
    """What distances are read from; `closed` and `agreement` ask less of faces told by winding number."""
    closed: bool
    """Every directed edge has its opposite; of a closed or meshed surface also: no face is empty or there twice, and
    it is wound outwards.
    """
    agreement: float
    """Share of points in and around the solid whose side is beyond doubt [-]: of a closed or meshed surface where
    winding number and ray parity say the same; by winding number where that is within 0.1 of a whole number.
    """
    hausdorff: float
    """Largest distance from the visible surface to the repaired one [m]."""
    mean: float
    """Mean of that distance over what of the surface can be seen [m]."""
    tolerance: float
    """What `hausdorff` had to stay below [m]."""
    spacing: float
    """Mean spacing of the places where it was measured, besides all vertices [m]."""
    volume: float
    """Enclosed volume [m^3]."""
    resolution: float
    """Cell of the remesh [m]; 0: the given faces were kept."""
    repairs: tuple[str, ...]
    """What was done, one sentence each; empty: nothing."""
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
