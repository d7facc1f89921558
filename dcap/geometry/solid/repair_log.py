"""Repairs of a surface, counted while they happen and told in sentences at the end."""

from collections.abc import Callable
from dataclasses import dataclass, field
from enum import StrEnum


class RepairKind(StrEnum):
    """Kinds of repairs; the amount that goes with each is in brackets."""

    WELDED = "welded"  # [1]
    DEGENERATE = "degenerate"  # [1]
    DUPLICATE = "duplicate"  # [1]
    JUNCTION = "junction"  # [1]
    TURNED = "turned"  # [1]
    STRAY = "stray"  # area [m^2]
    CAPPED = "capped"  # perimeter [m]
    WALLED = "walled"  # perimeter [m]
    THICKENED = "thickened"  # thickness [m]
    INVERTED = "inverted"  # [1]
    UNITED = "united"  # [1] for each piece
    REMESHED = "remeshed"  # cell [m]
    CRUMB = "crumb"  # volume [m^3]
    BY_WINDING = "by winding"  # [1]
    COLUMNS = "columns"  # width [m]
    HOLE = "hole"  # length [m]


SENTENCES: dict[RepairKind, Callable[[int, float, float], str]] = {
    RepairKind.WELDED: lambda n, total, most: f"{n} coinciding vertices welded",
    RepairKind.DEGENERATE: lambda n, total, most: f"{n} degenerate faces dropped",
    RepairKind.DUPLICATE: lambda n, total, most: f"{n} duplicate faces dropped",
    RepairKind.JUNCTION: lambda n, total, most: f"{n} faces split at T-junctions",
    RepairKind.TURNED: lambda n, total, most: f"{n} faces flipped to agree with their neighbours",
    RepairKind.STRAY: lambda n, total, most: f"{n} stray pieces of {1e4 * total:.3g} cm2 in all dropped",
    RepairKind.CAPPED: lambda n, total, most: f"{n} holes capped, the largest {most:.3g} m around",
    RepairKind.WALLED: lambda n, total, most: f"{n} borders, the longest {most:.3g} m, extruded down to the bottom",
    RepairKind.THICKENED: lambda n, total, most: f"{n} sheets thickened to {1e3 * most:.3g} mm at most",
    RepairKind.INVERTED: lambda n, total, most: f"{n} inside-out pieces flipped",
    RepairKind.UNITED: lambda n, total, most: f"{n} touching pieces united",
    RepairKind.REMESHED: lambda n, total, most: f"remeshed from its signed distance in cells of {1e3 * most:.2g} mm",
    RepairKind.CRUMB: lambda n, total, most: f"{n} tiny pieces of {1e6 * total:.2g} cm3 in all dropped",
    RepairKind.BY_WINDING: lambda n, total, most: (
        "faces kept as given, inside and outside decided by the winding number"
    ),
    RepairKind.HOLE: lambda n, total, most: f"{n} holes closed from their rims, the longest {1e2 * most:.2g} cm",
    RepairKind.COLUMNS: lambda n, total, most: (
        f"solid under what is seen from above, in columns of {1e3 * most:.2g} mm"
    ),
}
"""From number, sum and largest amount to a sentence, in the order of the work."""


@dataclass(slots=True)
class RepairLog:
    """The tally."""

    amounts: dict[RepairKind, list[float]] = field(default_factory=dict)

    def add(self, kind: RepairKind, amount: float = 1.0, times: int = 1) -> None:
        """Count something that was done `times` times."""
        if times:
            self.amounts.setdefault(kind, []).extend([amount] * times)

    def copy(self) -> "RepairLog":
        """A tally of its own."""
        return RepairLog({kind: list(values) for kind, values in self.amounts.items()})

    def sentences(self) -> tuple[str, ...]:
        """One for each kind of work."""
        return tuple(
            tell(len(self.amounts[kind]), sum(self.amounts[kind]), max(self.amounts[kind]))
            for kind, tell in SENTENCES.items()
            if kind in self.amounts
        )
