"""Cells with a sliver of material: what ties their nodes to others, and that contact does not fold them."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from threadpoolctl import threadpool_limits

from dcap.scene.types.mesh import Mesh
from solver.config import SolverConfig
from solver.model import soft as soft_system
from solver.model.bodies import Model
from solver.runtime import start
from solver.settle import ImplicitDrop
from solver.tl.ghost import WEAK, ghost_penalty
from solver.tl.simulation import StepControl

CELL = 0.012
SIZE = np.array([0.1, 0.1, 0.048])
TURN = Rotation.from_euler("xy", [0.13, 0.21]).as_matrix()  # about fixed axes


class TurnedBox:
    """A box that lies obliquely in the grid, so that its faces cut cells in every way."""

    def __init__(self, box):
        self.box, self.volume = box, box.volume

    def distance(self, points):
        return self.box.distance(points @ TURN)

    def surface(self, edge):
        plain = self.box.surface(edge)
        return Mesh.of(plain.vertices @ TURN.T, plain.faces)


def oblique_slab(lab, shear=None):
    """A slab around the origin, clamped at its bottom and turned in its grid; in layers that slip, with G_t given."""
    solid = TurnedBox(lab.Box(SIZE))
    corner = solid.surface(1.0).vertices
    low, high = np.floor(corner.min(axis=0) / CELL) - 1, np.ceil(corner.max(axis=0) / CELL) + 2
    planes = tuple(np.arange(a, b) * CELL for a, b in zip(low, high, strict=True))
    height = (np.stack(np.meshgrid(*planes, indexing="ij"), axis=-1) @ TURN)[..., 2]
    layers = None if shear is None else (4e5, 0.1, shear, TURN @ [0.0, 0.0, 1.0])
    return lab.soft("slab", solid, [0, 0, 0], E=2e4, nu=0.3 if layers is None else 0.1, cell=CELL, planes=planes,
                    fixed=True, loaded=True, held=height < 0.6 * CELL - 0.5 * SIZE[2], edge=0.006, spacing=0.004,
                    layers=layers)  # fmt: skip


def system(*bodies):
    return soft_system.build(Model(bodies, np.zeros(3)))


def dropped(lab, slab, block, down):
    """How an approach to rest ended, and the smallest volume ratio J of material then."""
    start(2)
    one = ImplicitDrop(Model((slab, block), lab.gravity * down), SolverConfig(threads=2))
    with threadpool_limits(1):
        end = one.approach(one.checked_start(), StepControl(one.config.step_seconds), None)
    return end, float(one.stepper.elastic.volume_ratio[one.soft.real].min())


def test_ties_vanish_for_affine_maps_and_have_neither_resultant_nor_moment(lab):
    """To rounding; for any other motion they hold against it."""
    soft = system(oblique_slab(lab))
    G, random = ghost_penalty(soft), np.random.default_rng(0)
    assert G.nnz > 500
    largest = abs(G).max()
    affine = soft.rest @ random.normal(size=(3, 3)) + 1.0
    assert np.abs(G @ affine).max() < 1e-12 * largest
    place = soft.rest + 1e-3 * random.normal(size=soft.rest.shape)
    force = -(G @ place)
    assert np.abs(force).max() > 1e-4 * largest
    assert np.abs(force.sum(axis=0)).max() < 1e-12 * largest
    assert np.abs(np.cross(place, force).sum(axis=0)).max() < 1e-12 * largest
    assert (place * force).sum() < 0.0


def test_only_nodes_with_hardly_any_material_are_tied(lab):
    """A box along the grid has none of them, not at its corners either; a face just above a plane has them all over."""
    box = lab.Box(np.array([0.06, 0.06, 0.03]))
    assert ghost_penalty(system(lab.soft("box", box, [0, 0, 0], E=1e4, cell=0.01))).nnz == 0
    across = lab.planes(-0.03, 0.03, -0.03, 0.03, 0.01)
    for share, tied in ((0.01, True), (0.01 + 0.25 * WEAK, False)):
        up = np.array([-0.015, -0.005, 0.005, 0.015]) - 0.01 * share
        up = np.concatenate([[-0.015], up[1:], [up[-1] + 0.01]])
        soft = system(lab.soft("box", box, [0, 0, 0], E=1e4, cell=0.01, planes=(across, across, up)))
        above = (soft.rest[:, 2] > 0.016) & (np.abs(soft.rest[:, :2]) < 0.029).all(axis=1)
        of_top = ghost_penalty(soft).diagonal()[above & (soft.rest[:, 2] < 0.026)]
        assert len(of_top) > 20
        assert (of_top > 0.0).all() == tied
        assert (of_top > 0.0).any() == tied


def test_the_tangent_with_ties_is_the_derivative_of_the_forces(lab):
    """At rest, along any motion of the nodes, to single precision."""
    start(2)
    one = ImplicitDrop(Model((oblique_slab(lab),), np.zeros(3)), SolverConfig(threads=2))
    stepper, state = one.stepper, one.start_state()
    stepper.elastic.damping = 0.0
    trial = stepper._linearise(state, stepper.problem(state, 1e3))
    stepper.prepare(trial)
    random, step = np.random.default_rng(0), 1e-7
    motion = random.normal(size=state.x.shape) * ~one.soft.held[:, None]
    forces = []
    for side in (1.0, -1.0):
        moved = state.copy()
        moved.x = state.x + side * step * motion
        forces.append(stepper.elastic.forces(moved))
    slope = (forces[1] - forces[0])[~one.soft.held] / (2.0 * step)
    found = trial.system.multiply(motion.ravel()).reshape(-1, 3)[~one.soft.held]
    assert found == pytest.approx(slope, abs=1e-5 * np.abs(slope).max())


@pytest.mark.slow
@pytest.mark.parametrize("shear", [None, 1e3])
def test_a_heavy_block_does_not_fold_the_cells_that_an_oblique_face_cuts(lab, shear):
    """2 kg on 50 x 40 mm crush foam, or layers, by a fifth: at rest with J = 0.32 or 0.21. Without ties slivers are
    inside out (J = -0.6 both), and so they are in layers that are tied by what makes them slip (J = -0.39)."""
    half = 0.015
    block = lab.rigid("block", lab.Box(np.array([0.05, 0.04, 2 * half])),
                      TURN @ [0.003, 0.002, 0.5 * SIZE[2] + half + 2e-4], mass=2.0, edge=0.005, spacing=0.001,
                      rotation=TURN)  # fmt: skip
    end, smallest = dropped(lab, oblique_slab(lab, shear), block, TURN @ [0.0, 0.0, -1.0])
    assert end.verdict == "at_rest"
    assert smallest > 0.1


@pytest.mark.long
@pytest.mark.slow
def test_depth_does_not_jump_where_cells_become_slivers(lab):
    """A block on a face that lies 0.2 to 20 % of a cell above a plane of the grid: within 2 % as deep as on one that
    lies in a plane."""
    thick, across = 0.048, lab.planes(-0.05, 0.05, -0.03, 0.03, 0.01, 1.5)
    depths = []
    for share in (0.0, 0.002, 0.01, 0.06, 0.12, 0.2):
        up = np.linspace(0.0, thick - share * CELL, 5)
        planes = (across, across, np.append(up, up[-1] + CELL) if share else up)
        slab = lab.soft("slab", lab.Box(np.array([0.1, 0.1, thick])), [0, 0, thick / 2], E=2e4, cell=CELL,
                        planes=planes, held=np.s_[:, :, 0], fixed=True, loaded=True, spacing=0.004)  # fmt: skip
        block = lab.rigid("block", lab.Box(np.array([0.05, 0.04, 0.03])), [0.003, 0.002, thick + 0.0152], mass=0.5,
                          edge=0.005, spacing=0.001)  # fmt: skip
        end, _ = dropped(lab, slab, block, np.array([0.0, 0.0, -1.0]))
        assert end.verdict == "at_rest"
        depths.append(thick + 0.015 - end.state.center[1][2])
    assert depths == pytest.approx([depths[0]] * len(depths), rel=0.02)
