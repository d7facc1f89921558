"""The proof of rest accepts what a drop came to, and nothing that was moved by hand afterwards."""

from collections.abc import Callable
from dataclasses import replace
from typing import Literal

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from dcap.scene.types.mesh import Mesh
from solver.config import SolverConfig
from solver.model.bodies import Body, Model
from solver.settle import settle
from tasks.bodies.proof import LARGEST_GAP_M, contact_proof, proven, refutation

Points = NDArray[np.float64]


def scenes(lab) -> dict[str, tuple[Body, ...]]:
    """Bodies of each kind on bodies of each kind, the free one first."""
    slab = lab.soft("slab", lab.Box(np.array([0.2, 0.2, 0.06])), [0, 0, -0.03], E=3e4, cell=0.0125, fixed=True,
                    held=np.s_[:, :, 0], loaded=True)  # fmt: skip
    return {
        "a rigid block on a floor": (
            lab.rigid("block", lab.Box(np.full(3, 0.05)), [0, 0, 0.0252], mass=0.5),
            lab.floor(),
        ),
        "a rigid ball on foam": (
            lab.rigid("ball", lab.Capsule(0.04, 0.0), [0, 0, 0.0405], mass=0.3, rolling=1e-3),
            slab,
        ),
        "a soft cube on a floor": (
            lab.soft("cube", lab.Box(np.full(3, 0.06)), [0, 0, 0.0305], E=2e4, rho=300.0, cell=0.0125),
            lab.floor(),
        ),
        "a soft cube on foam": (
            lab.soft("cube", lab.Box(np.full(3, 0.06)), [0, 0, 0.0305], E=3e4, rho=200.0, cell=0.0125),
            slab,
        ),
    }  # fmt: skip


def lifted(distance: float) -> Callable[[Points], Points]:
    """Moved up, or down, by a distance [m]."""
    return lambda points: points + np.array([0.0, 0.0, distance])


def turned(points: Points) -> Points:
    """Stood on an edge."""
    middle = points.mean(axis=0)
    return np.asarray((points - middle) @ Rotation.from_rotvec([0.6, 0.0, 0.0]).as_matrix().T + middle)


MOVES: dict[str, Callable[[Points], Points]] = {
    **{f"lifted by {1e3 * d:.1f} mm": lifted(d) for d in (2.0 * LARGEST_GAP_M, 1e-3, 5e-3, 2e-2)},
    **{f"pushed in by {1e3 * d:.1f} mm": lifted(-d) for d in (2.0 * LARGEST_GAP_M, 2e-3)},
    "stood on an edge": turned,
    "moved beside": lambda points: points + np.array([0.5, 0.0, 0.0]),
    "made smaller": lambda points: points.mean(axis=0) + 0.9 * (points - points.mean(axis=0)),
}


@pytest.mark.slow
@pytest.mark.parametrize("method", ["tl", pytest.param("mls", marks=pytest.mark.long)])
def test_a_state_that_was_moved_is_refuted(lab, method: Literal["tl", "mls"]) -> None:
    """Lifted from twice the gap on, pushed in, turned, or with its support gone: none holds; as it was, each does."""
    missed = []
    for name, bodies in scenes(lab).items():
        if method == "mls" and "rigid block" in name:
            continue
        model = Model(bodies, np.array([0.0, 0.0, -9.81]))
        result = proven(model, settle(model, SolverConfig(threads=2, method=method)))
        assert result.verdict == "at_rest", name
        assert result.certificate.proof is not None
        assert result.certificate.proof.holds
        ends = [one.vertices for one in result.bodies]
        for what, move in MOVES.items():
            if "ball" in name and move is turned:
                continue  # it has no edge
            own, support = move(ends[0]), ends[1]
            surfaces = [Mesh.of(x, b.faces) for x, b in zip((own, support), model.bodies, strict=True)]
            if contact_proof(model, surfaces, result.forces, LARGEST_GAP_M).holds:
                missed.append(f"{name}, {what}")
        surfaces = [Mesh.of(x, b.faces) for x, b in zip((ends[0], ends[1] - [0, 0, 1]), model.bodies, strict=True)]
        if contact_proof(model, surfaces, result.forces, LARGEST_GAP_M).holds:
            missed.append(f"{name}, without support")
        check_forces(model, result, missed, name)
    assert missed == []


def check_forces(model: Model, result, missed: list[str], name: str) -> None:
    """Forces that are gone, too small, or no numbers are no rest; the verdict and a message say so."""
    forces = result.forces
    for what, changed in {
        "without forces": forces.force[:0],
        "with half the force": 0.5 * forces.force,
        "with a force that is no number": np.where(np.arange(len(forces.force))[:, None] == 0, np.nan, forces.force),
    }.items():
        count = len(changed)
        other = replace(forces, a=forces.a[:count], b=forces.b[:count], position=forces.position[:count],
                        force=changed, bonded=forces.bonded[:count])  # fmt: skip
        found = proven(model, replace(result, forces=other))
        if found.verdict != "no_equilibrium" or not found.warnings[-1]:
            missed.append(f"{name}, {what}")
        assert found.certificate.proof is not None
        assert "nan" not in refutation(found.certificate.proof)
