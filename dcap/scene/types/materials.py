"""Discrete materials of the parts that take part in the simulation."""

from dataclasses import dataclass
from enum import StrEnum


class BodyModel(StrEnum):
    """How a part is simulated."""

    RIGID = "rigid"
    MPM = "mpm"


@dataclass(frozen=True, slots=True)
class ContactFriction:
    """What resists motion along a contact; of a pair of bodies the geometric mean of the two counts."""

    static: float
    """Coefficient of static friction mu_s [-]."""
    dynamic: float
    """Coefficient of dynamic friction mu_d [-]."""
    rolling_resistance: float
    """Rolling resistance length [m]."""


@dataclass(frozen=True, slots=True)
class Material:
    """One row of materials.csv."""

    id: str
    density: float
    """Mass density rho [kg/m^3]."""
    youngs_modulus: float
    """Young's modulus E [Pa]."""
    poisson_ratio: float
    """Poisson ratio nu [-]."""
    static_friction: float
    """Coefficient of static friction mu_s [-]."""
    dynamic_friction: float
    """Coefficient of dynamic friction mu_d [-]."""
    rolling_resistance: float
    """Rolling resistance length [m]."""
    kind: str
    """rigid | soft | thin."""
    source: str

    @property
    def friction(self) -> ContactFriction:
        """What it contributes to a contact."""
        return ContactFriction(self.static_friction, self.dynamic_friction, self.rolling_resistance)


@dataclass(frozen=True, slots=True)
class PartMaterial:
    """The choice for one part."""

    body: str
    """Instance id, or 'object'."""
    part: str
    """Part name."""
    part_index: int
    """Index into the instance's parts."""
    material: Material
    """The library row; density may be an effective one (hollow things, mass prior), then `reason` says so."""
    model: BodyModel
    reason: str


@dataclass(frozen=True, slots=True)
class PartMaterials:
    """All choices; object first, then base, then neighbours."""

    rows: tuple[PartMaterial, ...]
    limits: str
    """'none' or 'paper_limits'."""
    notes: tuple[str, ...] = ()
    """What was treated otherwise than its row says, one sentence each."""

    def of(self, body: str, part_index: int) -> PartMaterial:
        """The row of one part."""
        return next(r for r in self.rows if r.body == body and r.part_index == part_index)

    def of_parts(self, body: str, count: int) -> list[PartMaterial]:
        """The rows of all parts of a body, in their order."""
        return [self.of(body, index) for index in range(count)]
