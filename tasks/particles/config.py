"""Extent and resolution of the simulation."""

from pydantic import BaseModel, NonNegativeFloat, PositiveFloat, PositiveInt


class ParticlesConfig(BaseModel, frozen=True, extra="forbid"):
    """Extent and resolution of the simulation."""

    crop_margin: PositiveFloat = 0.75
    """The base is cut this far around the object, in units of its larger horizontal side [-]."""
    least_crop_margin: PositiveFloat = 0.15
    """... but at least this far [m]."""
    rolling_margin: PositiveFloat = 2.5
    """Times farther around a ball, which may roll before it rests [-]."""
    cell: PositiveFloat | None = None
    """Cell size at the contact that was asked for [m]; without it the predicted contact decides."""
    cells_across: PositiveFloat = 5.0
    """Cells in half the width of the predicted contact."""
    coarser: PositiveFloat = 1.0
    """Cells are so many times larger than that: where a drop broke down on the smaller ones [-]."""
    uniform: bool = False
    """Cells of one size in the whole base, as many as its budget allows, and a soft object filled without looking for
    its thin parts: an ablation."""
    least_cells_across: PositiveFloat = 4.0
    """Cells are never coarser than this many in half that width without a note."""
    coarsest_cell: PositiveFloat = 0.025
    """Largest cell under an extended contact [m]."""
    finest_cell: PositiveFloat = 0.0015
    """Smallest cell under the contact [m]: what a picture can show."""
    cells_through: PositiveInt = 4
    """Cells through the thinnest dimension of a soft object."""
    least_cells_through: PositiveFloat = 3.0
    """Fewer are named in a note."""
    object_cells: PositiveInt = 2500
    """Budget of cells of a soft object."""
    base_cells: PositiveInt = 7000
    """Budget of cells of the base."""
    base_faces: PositiveInt = 120_000
    """Budget of faces that refining adds to a soft base under the object; each is a point of contact."""
    object_faces: PositiveInt = 60_000
    """Budget of faces that refining adds to the object where it may touch."""
    particle_limit: PositiveInt = 250_000
    """More particles than this are refused."""
    distance_samples: PositiveInt = 1_000_000
    """Budget of samples of a base's or a neighbour's distance."""
    object_distance_samples: PositiveInt = 3_000_000
    """Budget of samples of the object's distance: its edges are rounded by a quarter of their spacing."""
    hold_distance: NonNegativeFloat = 2e-3
    """Soft nodes nearer than this to a rigid part of the base are bonded to it [m]."""
    hole_perimeter: NonNegativeFloat = 0.25
    """Holes of a support's surface up to this perimeter are closed [m]."""
    least_thickness: PositiveFloat = 0.04
    """A soft part seen only as a sheet is at least this thick [m]."""
    mass_trust: PositiveFloat = 1.5
    """Density times volume counts for solid things while it is within this factor of the usual mass [-]."""
    shell: PositiveFloat = 0.03
    """Thickness of a rigid sheet [m]."""
    contact_vertices: PositiveInt = 6000
    """Contact points of the object; a finer mesh is simplified for the drop, pictures keep the fine one."""
