"""Displacement and stress of the material at the end, particle by particle."""

import numpy as np

from solver.mls.bodies import SoftBodies
from solver.model.stress import corotated_stress, rotations, voigt
from solver.motion import MaterialState


def material_states(soft: SoftBodies) -> dict[str, MaterialState]:
    """Every soft body's material by its name; rigid cores carry no stress that is known, it is given as zero."""
    particles = soft.particles
    place = particles.given(particles.x)
    deformation = particles.given(particles.F).reshape(-1, 3, 3)
    found = {}
    for part, index in enumerate(soft.index):
        mine, sample = np.flatnonzero(soft.part == part), soft.samples[part]
        F = deformation[mine]
        J = np.linalg.det(F)
        sigma = voigt(corotated_stress(F, rotations(F), J, sample.mu, sample.lam))
        start = soft.start[mine]
        found[soft.model.bodies[index].name] = MaterialState(start, place[mine] - start, sample.volume, J, sigma)
    return found
