"""Elastic forces of all soft bodies and the drag of material damping, with what the kernels leave behind."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy import sparse

from solver.kernels import damping, elastic, layers
from solver.model.soft import SoftSystem
from solver.model.state import State


@dataclass(frozen=True, eq=False, slots=True)
class StepStrain:
    """Strains at the start of a step, from which material damping measures."""

    rate: float
    """Damping beta over the step's length [-]."""
    stretch: NDArray[np.float64]
    """Stretch S of each particle, F = R S, shape (p, 9)."""
    modes: NDArray[np.float64]
    """Bending amplitudes of each cell, shape (c, 6)."""
    layers: NDArray[np.float64]
    """Measures of the layers at each particle, shape (p, 6)."""


class ElasticForces:
    """Forces at a state; holds the particles' deformation at the last one."""

    def __init__(self, soft: SoftSystem, ghost: sparse.csr_matrix, material_damping: float) -> None:
        self.soft = soft
        self.ghost = ghost
        """Ghost penalty [N/m], ghost.py; it is not damped, as its drag would brake turns, shape (n, n)."""
        self.damping = material_damping
        """Stiffness-proportional damping beta [s]."""
        cells, particles = len(soft.cell_node), len(soft.volume)
        self.cell_force = np.zeros((cells, 8, 3))
        self.place = np.zeros((0, 3))
        """Node positions that the rest belongs to [m]."""
        self.polar = np.zeros((0, 9))
        """Rotations of the particles' polar decompositions."""
        self.deformation = np.zeros((particles, 9))
        self.volume_ratio = np.ones(particles)
        self.energy = np.zeros(particles)

    def forces(self, state: State, since: StepStrain | None = None) -> NDArray[np.float64]:
        """Elastic node forces [N], shape (n, 3), with the drag of material damping `since` the start of a step; updates
        the particles' deformation, rotation and energy."""
        f = np.zeros_like(state.x)
        if len(f):
            s = self.soft
            elastic.cell_forces(
                state.x, s.cell_node, s.cell_size, s.cell_start, s.local, s.volume, s.mu, s.lam, s.relief,
                state.polar,
                self.deformation, self.volume_ratio, self.energy, self.cell_force,
            )  # fmt: skip
            self.place, self.polar = state.x.copy(), state.polar
            if len(s.layered):
                layers.add_layer_forces(
                    s.layered, s.cell_size, s.cell_start, s.local, s.volume, s.added, s.frame, self.deformation,
                    self.energy, self.cell_force,
                )  # fmt: skip
            if since is not None:
                damping.add_drag(
                    since.rate, state.x, s.cell_node, s.cell_size, s.cell_start, s.local, s.volume, s.mu, s.lam,
                    s.relief, self.deformation, state.polar, since.stretch, since.modes, self.cell_force,
                )  # fmt: skip
            if since is not None and len(s.layered):
                layers.add_layer_drag(
                    since.rate, s.layered, s.cell_size, s.cell_start, s.local, s.volume, s.added, s.frame,
                    self.deformation, since.layers, self.cell_force,
                )  # fmt: skip
            elastic.gather_forces(s.node_cell, self.cell_force, f)
            f -= self.ghost @ state.x
        return f

    def evaluate(self, state: State) -> None:
        """Make the particles' deformation that of a state, and the state's rotations its own."""
        if not np.array_equal(state.x, self.place):
            self.forces(state)
        elif state.polar is not self.polar:
            state.polar[:] = self.polar

    def strain(self, state: State, dt: float) -> StepStrain | None:
        """Reference state of material damping in a step from this state, None without damping."""
        if self.damping == 0.0 or not len(state.x):
            return None
        self.evaluate(state)
        s = self.soft
        stretch, modes = np.empty_like(self.deformation), np.empty((len(s.cell_node), 6))
        damping.start_strains(state.x, s.cell_node, s.cell_size, self.deformation, state.polar, stretch, modes)
        measures = np.zeros((len(stretch), 6))
        layers.start_layers(s.layered, s.cell_start, s.frame, self.deformation, measures)
        return StepStrain(self.damping / dt, stretch, modes, measures)
