"""Stress at material points: closed forms of a stretched and turned block."""

import numpy as np
import pytest

from solver.config import SolverConfig
from solver.model import soft as soft_system
from solver.model.bodies import Model
from solver.model.soft import lame
from solver.model.state import start_state
from solver.model.stress import VOIGT, corotated_stress, rotations
from solver.runtime import start
from solver.tl.measure import material_states

E, NU = 2e4, 0.3


@pytest.fixture(autouse=True)
def kernels():
    start(2, "cpu")


def block(lab, layers=None):
    return lab.soft("block", lab.Box(np.array([0.2, 0.1, 0.1])), [0, 0, 0.05], E=E, nu=NU, cell=0.025,
                    held=np.s_[:, :, 0], fixed=True, loaded=True, layers=layers)  # fmt: skip


def deformed(lab, F, layers=None):
    """The block under a homogeneous deformation x = F X."""
    model = Model((block(lab, layers),), np.array([0.0, 0.0, -9.81]))
    soft = soft_system.build(model)
    state = start_state(model, soft, None)
    state.x[:] = soft.rest @ F.T
    return soft, material_states(soft, state)[0]


def test_a_stretched_block_has_hooke_s_stress(lab):
    """A small uniaxial strain: (lambda + 2 mu) e along it and lambda e across."""
    e = 1e-4
    _, found = deformed(lab, np.diag([1.0 + e, 1.0, 1.0]))
    mu, lam = lame(np.array(E), np.array(NU))
    assert found.stress[:, 0] == pytest.approx((lam + 2 * mu) * e, rel=1e-3)
    assert found.stress[:, 1:3] == pytest.approx(lam * e, rel=1e-3)
    assert np.abs(found.stress[:, 3:]).max() < 1e-6
    assert found.volume_ratio == pytest.approx(1.0 + e, rel=1e-9)
    assert found.displacement == pytest.approx(found.start * [e, 0.0, 0.0], abs=1e-12)
    assert found.volume.sum() == pytest.approx(0.2 * 0.1 * 0.1, rel=1e-4)


@pytest.mark.parametrize("layers", [None, (4e4, 0.2, 3e3, (0.0, 0.0, 1.0))], ids=["isotropic", "layered"])
def test_stress_turns_with_the_body(lab, layers):
    """Q F has the stress Q sigma Q^T."""
    stretch = np.eye(3) + 1e-3 * np.array([[2.0, 0.5, 0.0], [0.5, -1.0, 0.3], [0.0, 0.3, 1.0]])
    c, s = np.cos(0.7), np.sin(0.7)
    turn = np.array([[c, 0.0, s], [0.0, 1.0, 0.0], [-s, 0.0, c]])
    _, plain = deformed(lab, stretch, layers)
    _, turned = deformed(lab, turn @ stretch, layers)
    expected = np.einsum("ij,pjk,lk->pil", turn, matrices(plain.stress), turn)
    assert matrices(turned.stress) == pytest.approx(expected, abs=1e-6 * np.abs(expected).max())


def test_layers_add_to_what_is_across_and_along_them(lab):
    """A small strain along layers: the modulus is theirs, not that of the material between."""
    e, along = 1e-4, 8e4
    F = np.diag([1.0 + e, 1.0, 1.0])
    _, bare = deformed(lab, F)
    _, found = deformed(lab, F, (along, 0.2, 3e3, (0.0, 0.0, 1.0)))
    assert found.stress[:, 0].mean() > 2.0 * bare.stress[:, 0].mean()


def matrices(stress):
    whole = np.zeros((len(stress), 3, 3))
    for k, (i, j) in enumerate(VOIGT):
        whole[:, i, j] = whole[:, j, i] = stress[:, k]
    return whole


def test_rigid_bodies_have_no_material(lab):
    model = Model((lab.floor(), lab.rigid("cube", lab.Box(np.array([0.1, 0.1, 0.1])), [0, 0, 0.06])), np.zeros(3))
    soft = soft_system.build(model)
    assert material_states(soft, start_state(model, soft, None)) == {}
    assert SolverConfig().method == "tl"


def test_rotations_are_those_of_the_polar_decomposition():
    """F = R S with S symmetric and positive, also where F mirrors: there det R stays 1."""
    noise = np.random.default_rng(0).normal(size=(50, 3, 3))
    F = np.eye(3) + 0.2 * noise
    R = rotations(F)
    stretch = np.einsum("pji,pjk->pik", R, F)
    assert np.linalg.det(R) == pytest.approx(1.0)
    assert stretch == pytest.approx(stretch.transpose(0, 2, 1), abs=1e-12)
    assert np.linalg.det(rotations(np.diag([1.0, 1.0, -0.5])[None])) == pytest.approx(1.0)


def test_stress_is_the_slope_of_the_energy():
    """P = d psi / d F of psi = mu |F - R|^2 + lambda / 2 (J - 1)^2, by central differences; sigma = P F^T / J."""
    F = np.eye(3) + 0.1 * np.random.default_rng(1).normal(size=(3, 3))
    mu, lam = 3e3, 5e3

    def energy(one):
        R = rotations(one[None])[0]
        return mu * np.sum((one - R) ** 2) + 0.5 * lam * (np.linalg.det(one) - 1.0) ** 2

    slope = np.zeros((3, 3))
    for i, j in np.ndindex(3, 3):
        step = np.zeros((3, 3))
        step[i, j] = 1e-5
        slope[i, j] = (energy(F + step) - energy(F - step)) / 2e-5
    J = np.linalg.det(F)
    found = corotated_stress(F[None], rotations(F[None]), np.array([J]), np.array([mu]), np.array([lam]))[0]
    assert found == pytest.approx(slope @ F.T / J, rel=1e-6, abs=1e-3)
