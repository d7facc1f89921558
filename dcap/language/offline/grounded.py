"""Target of a sentence in a given scene, while it is worked out: filled by `target`, `where` and `limits`."""

from collections.abc import Sequence
from dataclasses import dataclass, field

from dcap.language.offline.ground import Found
from dcap.language.offline.likelihood import label_thing
from dcap.language.offline.reading import Place
from dcap.language.protocol.replies import Candidate, Constraint
from dcap.language.protocol.requests import InstanceView


@dataclass(slots=True)
class Target:
    """Base, regions, references and constraints found so far."""

    base: InstanceView | None = None
    missing: str = ""
    meant: str = ""
    """The label that comes nearest to what is missing."""
    part: str = ""
    which: str = ""
    regions: list[str] = field(default_factory=list)
    references: list[str] = field(default_factory=list)
    words: list[str] = field(default_factory=list)
    not_understood: list[str] = field(default_factory=list)
    notes: list[str] = field(default_factory=list)
    used: list[Place] = field(default_factory=list)
    """Places that chose the base and say nothing more."""
    candidates: tuple[Candidate, ...] = ()
    """Candidates for the base's noun, the base first."""
    reference_candidates: tuple[Candidate, ...] = ()
    """Candidates for a reference, if that is open."""
    constraints: list[Constraint] = field(default_factory=list)
    lean_on: str = ""

    def add_regions(self, names: Sequence[str]) -> None:
        """Regions that are not there yet."""
        self.regions.extend(name for name in names if name not in self.regions)

    def add_references(self, names: Sequence[str]) -> None:
        """References that are not there yet."""
        self.references.extend(name for name in names if name not in self.references)


def as_candidates(found: Found) -> tuple[Candidate, ...]:
    """Candidates for a noun, as the reply lists them; instances that are not likely at all are left out."""
    pairs = zip(found.instances, found.scores, strict=True)
    return tuple(Candidate(id=one.id, likelihood=score) for one, score in pairs if score > 0.0)


def is_any(instance: InstanceView) -> bool:
    """Whether one of it is as good as another: walls, next to or against any of which a thing may be."""
    return instance.structure and label_thing(instance) in ("wall", "floor", "ceiling")
