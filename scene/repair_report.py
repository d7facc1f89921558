"""What was repaired on a surface so that it encloses a solid, and how far that moved what can be seen."""

from dataclasses import dataclass


@dataclass(frozen=True, slots=True)
class RepairReport:
    """One surface; lengths in metres."""

    closed: bool
    """Every directed edge has its opposite, and no face is empty or there twice."""
    agreement: float
    """Share of points in and around the solid where winding number and ray parity say the same [-]."""
    hausdorff: float
    """Largest distance from the visible surface to the repaired one [m]."""
    mean: float
    """Mean of that distance over the visible area [m]."""
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
