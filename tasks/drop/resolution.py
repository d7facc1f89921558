"""Whether explicit steps see every layer under the contact: too coarse a cell feels only the mean of several.

The paper asks for three to five particles through the thinnest thickness. Cells of the default settings have more, so
this refuses what a coarse `--resolution` or a small budget of cells leaves too few of.
"""

import numpy as np

from dcap.scene.errors import GeometryError
from dcap.scene.types.particles import Particles, SoftSimulationBody
from tasks.bodies.plan_contact import within_any

LEAST_PARTICLES = 3.0
PER_CELL = 2.0
"""Particles through a cell."""


def refuse_coarse_layers(particles: Particles) -> None:
    """GeometryError with what it would take where a layer under the contact has too few particles through it."""
    if particles.foreseen is None:
        return
    for body in particles.bodies:
        if not isinstance(body, SoftSimulationBody) or body.instance == "object":
            continue
        points = body.surface.vertices
        below = points[within_any(points, particles.foreseen)]
        for layer in particles.column if len(below) else ():
            ends = below[:, 2].max() - np.array([layer.to_m, layer.from_m])
            cells = float(np.diff(np.interp(ends, body.grid.z, np.arange(len(body.grid.z))))[0])
            if layer.to_m > layer.from_m and PER_CELL * cells < LEAST_PARTICLES:
                thick = layer.to_m - layer.from_m
                raise GeometryError(
                    f"solver mls: {PER_CELL * cells:.1f} particles through {layer.part} ({1e3 * thick:.0f} mm) under "
                    f"the contact, and explicit steps need {LEAST_PARTICLES:.0f}: give --resolution "
                    f"{PER_CELL * thick / LEAST_PARTICLES:.2g} or finer, more cells (ParticlesConfig.base_cells), or "
                    "--solver tl"
                )
