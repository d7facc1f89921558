"""Discrete materials of the parts that take part in the simulation."""

import math
from dataclasses import dataclass
from enum import StrEnum


class BodyModel(StrEnum):
    """Models of a simulated part."""

    RIGID = "rigid"
    MPM = "mpm"


@dataclass(frozen=True, slots=True)
class ContactFriction:
    """Friction of a contact; a pair of bodies uses the geometric mean of the two."""

    static: float
    """Coefficient of static friction mu_s [-]."""
    dynamic: float
    """Coefficient of dynamic friction mu_d [-]."""
    rolling_resistance: float
    """Rolling resistance length [m]."""


@dataclass(frozen=True, slots=True)
class LayerConstants:
    """Further constants of a layered material, whose E and nu are then those across the layers (transverse
    isotropy)."""

    youngs_modulus: float
    """Young's modulus E_p in the layers [Pa]."""
    poisson_ratio: float
    """Poisson ratio nu_p in the layers [-]."""
    shear_modulus: float
    """Shear modulus G_t between the layers [Pa]."""

    def problem(self, across: float, poisson: float) -> str:
        """Description of a value for which some strain costs no energy, with the material's E_t [Pa] and nu_tp; empty
        if there is none.

        The compliance is positive definite if E_t, E_p and G_t are, |nu_p| < 1 and nu_tp^2 < (1 - nu_p) E_t / (2 E_p).
        """
        for name, value in (("Young's modulus in", self.youngs_modulus), ("shear modulus between", self.shear_modulus)):
            if not value > 0.0:
                return f"{name} the layers is {value:g} Pa, must be positive"
        if not -1.0 < self.poisson_ratio < 1.0:
            return f"Poisson ratio in the layers is {self.poisson_ratio:g}, must lie between -1 and 1"
        most = math.sqrt(0.5 * (1.0 - self.poisson_ratio) * across / self.youngs_modulus)
        if not abs(poisson) < most:
            return (
                f"Poisson ratio across the layers is {poisson:g}, must be below {most:.3g} = sqrt((1 - nu_p) E_t / (2 "
                f"E_p)) for a positive definite stiffness, with E_t {across:g} Pa, E_p {self.youngs_modulus:g} Pa and "
                f"nu_p {self.poisson_ratio:g}"
            )
        return ""


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
    """Kind: rigid | soft | thin."""
    source: str
    layers: LayerConstants | None = None
    """Constants of a layered material, such as a stack of cloth; None: isotropic."""

    @property
    def friction(self) -> ContactFriction:
        """Contribution to the friction of a contact."""
        return ContactFriction(self.static_friction, self.dynamic_friction, self.rolling_resistance)


@dataclass(frozen=True, slots=True)
class PartMaterial:
    """The material chosen for one part."""

    body: str
    """Instance id, or 'object'."""
    part: str
    """Part name."""
    part_index: int
    """Index into the instance's parts."""
    material: Material
    """The row of the library; its density may be an effective one (hollow things, mass prior), as stated in
    `reason`."""
    model: BodyModel
    reason: str


@dataclass(frozen=True, slots=True)
class PartMaterials:
    """All choices: first the object, then the base, then neighbours."""

    rows: tuple[PartMaterial, ...]
    limits: str
    """Limits of the constants: 'none' or 'paper_limits'."""
    notes: tuple[str, ...] = ()
    """Deviations from the rows, one sentence each."""

    def of(self, body: str, part_index: int) -> PartMaterial:
        """The row of one part."""
        return next(r for r in self.rows if r.body == body and r.part_index == part_index)

    def of_parts(self, body: str, count: int) -> list[PartMaterial]:
        """The rows of all parts of a body, in their order."""
        return [self.of(body, index) for index in range(count)]
