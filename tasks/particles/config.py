"""Extent and resolution of the simulation."""

from pydantic import BaseModel, NonNegativeFloat, PositiveFloat, PositiveInt


class ParticlesConfig(BaseModel, frozen=True, extra="forbid"):
    """Extent and resolution of the simulation."""

    crop_margin: PositiveFloat = 0.75
    """Margin of the base around the object, over the object's larger horizontal side [-]."""
    least_crop_margin: PositiveFloat = 0.15
    """Least margin [m]."""
    rolling_margin: PositiveFloat = 2.5
    """Factor of that margin around a ball, which may roll [-]."""
    cell: PositiveFloat | None = None
    """Cell size at the contact [m]; default: from the predicted contact."""
    cells_across: PositiveFloat = 5.0
    """Cells in half the width of the predicted contact."""
    coarser: PositiveFloat = 1.0
    """Factor of the cell size; larger than 1 when a broken drop is repeated [-]."""
    uniform: bool = False
    """One cell size in the whole base, and no refinement of a soft object's thin parts: an ablation."""
    least_cells_across: PositiveFloat = 4.0
    """Fewer cells in half the width of the contact are reported in a note."""
    coarsest_cell: PositiveFloat = 0.025
    """Largest cell under an extended contact [m]."""
    finest_cell: PositiveFloat = 0.0015
    """Smallest cell under the contact [m]."""
    cells_through: PositiveInt = 4
    """Cells through the thinnest dimension of a soft object."""
    least_cells_through: PositiveFloat = 3.0
    """Fewer cells through a soft object are reported in a note."""
    object_cells: PositiveInt = 2500
    """Budget of cells of a soft object."""
    base_cells: PositiveInt = 7000
    """Budget of cells of the base."""
    base_faces: PositiveInt = 120_000
    """Budget of faces that refinement adds to a soft base under the object."""
    object_faces: PositiveInt = 60_000
    """Budget of faces that refinement adds to the object where it may touch."""
    particle_limit: PositiveInt = 250_000
    """Maximum number of particles."""
    distance_samples: PositiveInt = 1_000_000
    """Budget of distance samples of a base or a neighbour."""
    object_distance_samples: PositiveInt = 3_000_000
    """Budget of distance samples of the object."""
    hold_distance: NonNegativeFloat = 2e-3
    """Soft nodes nearer than this to a rigid part of the base are bonded to it [m]."""
    hole_perimeter: NonNegativeFloat = 0.25
    """Holes of a support up to this perimeter are closed [m]."""
    least_thickness: PositiveFloat = 0.04
    """Least thickness of a soft part seen only as a sheet [m]."""
    mass_trust: PositiveFloat = 1.5
    """A solid thing's mass is density times volume if that is within this factor of the usual mass [-]."""
    shell: PositiveFloat = 0.03
    """Thickness of a rigid sheet [m]."""
    contact_vertices: PositiveInt = 6000
    """Contact points of the object; a finer mesh is simplified for the drop, not for pictures."""
