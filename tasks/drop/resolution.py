"""Whether explicit steps see a soft object and every layer under the contact.

Too coarse a cell feels only the mean of several layers.

The paper asks for three to five particles through the thinnest thickness. Cells of the default settings have more, so
this refuses what a coarse `--resolution` or a small budget of cells leaves too few of.
"""

import numpy as np

from dcap.scene.errors import GeometryError
from dcap.scene.types.particles import Particles, SoftSimulationBody
from tasks.bodies.plan_contact import within_any
from tasks.bodies.thin_parts import interval_at, thin_profile

LEAST_PARTICLES = 3.0
PER_CELL = 2.0
"""Particles through a cell."""


def refuse_coarse_layers(particles: Particles) -> None:
    """GeometryError with what it would take where a soft object, or a layer under the contact, has too few particles
    through it."""
    for body in particles.bodies:
        if not isinstance(body, SoftSimulationBody):
            continue
        if body.instance == "object":
            profile = thin_profile(body.distance, 2, body.surface.bounds)
            through = PER_CELL * profile.thickness / interval_at(body.grid.z, profile.place)
            thinnest = int(through.argmin())
            refuse_few(float(through[thinnest]), "the object", float(profile.thickness[thinnest]), "object_cells")
        elif particles.foreseen is not None:
            points = body.surface.vertices
            below = points[within_any(points, particles.foreseen)]
            for layer in particles.column if len(below) else ():
                ends = below[:, 2].max() - np.array([layer.to_m, layer.from_m])
                cells = float(np.diff(np.interp(ends, body.grid.z, np.arange(len(body.grid.z))))[0])
                if layer.to_m > layer.from_m:
                    where = f"{layer.part} under the contact"
                    refuse_few(PER_CELL * cells, where, layer.to_m - layer.from_m, "base_cells")


def refuse_few(through: float, where: str, thickness: float, setting: str) -> None:
    """GeometryError for too few particles through something of a thickness [m]."""
    if through < LEAST_PARTICLES:
        raise GeometryError(
            f"solver mls: {through:.1f} particles through {where} ({1e3 * thickness:.3g} mm thick), and explicit steps "
            f"need {LEAST_PARTICLES:.0f}: give --resolution {PER_CELL * thickness / LEAST_PARTICLES:.2g} or finer, "
            f"more cells (ParticlesConfig.{setting}), or --solver tl"
        )
