"""A second drop of a case whose body came to rest where nobody had foreseen it."""

from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest

from dcap.scene.errors import InputError
from dcap.scene.types.particles import SoftSimulationBody
from solver.certificate import Verdict
from solver.errors import UnstableStep
from solver.result import SettledModel
from tasks.case.bodies import case_particles
from tasks.case.file import Case, checked_case
from tasks.case.run import as_ended, dropped_again, elsewhere, run_case

FOAM = {"density": 60, "youngs_modulus": 5e4, "poisson_ratio": 0.3, "static_friction": 0.6, "dynamic_friction": 0.5}
SLAB = {"name": "slab", "shape": {"box": {"size": [0.8, 0.3, 0.08]}}, "position": [0.2, 0, 0.04], "motion": "fixed",
        "material": FOAM}  # fmt: skip
BALL = {"name": "ball", "shape": {"sphere": {"radius": 0.05}}, "position": [0.0, 0, 0.131], "mass": 1.0,
        "material": "steel"}  # fmt: skip
FAR = 0.4


def rolled() -> Case:
    """A ball on a slab."""
    return checked_case({"bodies": [SLAB, BALL]}, "case")


def ended(shift: float, verdict: Verdict = Verdict.AT_REST) -> SettledModel:
    """The ball has moved along the slab; all that carries it is the slab."""
    still = SimpleNamespace(rotation=np.eye(3), translation=np.zeros(3))
    moved = SimpleNamespace(rotation=np.eye(3), translation=np.array([shift, 0.0, -0.005]))
    row = SimpleNamespace(a="ball", b="slab", normal_force_n=9.81)
    touching = np.array([[shift, 0.0, 0.08], [shift + 0.005, 0.0, 0.08]])
    found = SimpleNamespace(
        verdict=verdict, bodies=[still, moved], contacts=(row,), contact_points={"ball": touching}, warnings=()
    )
    return cast("SettledModel", found)


def test_a_body_that_rolled_is_dropped_again() -> None:
    """Not one that stayed, nor one that never came to rest."""
    assert elsewhere(rolled(), Path(), ended(FAR))
    assert not elsewhere(rolled(), Path(), ended(0.0))
    assert not elsewhere(rolled(), Path(), ended(FAR, Verdict.NO_EQUILIBRIUM))


@pytest.mark.slow
@pytest.mark.long
def test_the_second_drop_has_fine_cells_where_the_first_one_ended() -> None:
    """And where the ball comes down, as the first one had."""
    case = rolled()

    def cell_at(later: Case | None, x: float) -> float:
        slab = case_particles(case, Path(), None, later).bodies[0]
        assert isinstance(slab, SoftSimulationBody)
        return float(np.diff(slab.grid.x)[np.searchsorted(slab.grid.x, x) - 1])

    again = as_ended(case, ended(FAR))
    assert cell_at(None, FAR) > 3.0 * cell_at(None, 0.0)
    assert cell_at(again, FAR) == pytest.approx(cell_at(again, 0.0), rel=0.3)
    assert cell_at(again, 0.0) == pytest.approx(cell_at(None, 0.0), rel=0.3)


def test_where_the_second_drop_fails_the_first_one_stays() -> None:
    """With a word about it."""

    def broken(_: object) -> SettledModel:
        raise UnstableStep("step ends unbalanced")

    kept, told = dropped_again(rolled(), Path(), ended(FAR), broken)
    assert kept is None
    assert "step ends unbalanced" in told
    kept, told = dropped_again(rolled(), Path(), ended(FAR), lambda _: ended(FAR, Verdict.NO_EQUILIBRIUM))
    assert kept is None
    kept, told = dropped_again(rolled(), Path(), ended(FAR), lambda _: ended(FAR))
    assert kept is not None
    assert "dropped again" in told


def test_a_resolution_that_nobody_waits_for_is_refused_also_where_nothing_touches(tmp_path: Path) -> None:
    """A slab alone at 0.1 mm."""
    with pytest.raises(InputError, match="raise --resolution"):
        run_case({"bodies": [SLAB]}, tmp_path / "out", resolution=1e-4, quiet=True)
