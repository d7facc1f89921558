"""`dcap drop --load-aware`: what nobody would see give under the load is rigid, what one would see stays soft."""

import json
from pathlib import Path
from typing import Any

import pytest

from solver.config import SolverConfig
from tasks.case.contacts import load_aware
from tasks.case.file import Case
from tasks.case.run import run_case

INVISIBLE = SolverConfig().penetration_target
BALL = {"name": "ball", "shape": {"sphere": {"radius": 0.05}}, "position": [0, 0, 0.1501], "mass": 1.0,
        "material": "steel"}  # fmt: skip
# Hertz: d = (9 W^2 / (16 R E*^2))^(1/3) is the bound at this E* = E / (1 - nu^2)
LIMIT = (1.0 - 0.3**2) * (9.0 * 9.81**2 / (16.0 * 0.05 * INVISIBLE**3)) ** 0.5


def block(size: list[float], youngs_modulus: float, **more: object) -> dict[str, object]:
    """A fixed soft block below z = 0.1."""
    material = {"density": 200, "youngs_modulus": youngs_modulus, "poisson_ratio": 0.3, "static_friction": 0.5,
                "dynamic_friction": 0.4}  # fmt: skip
    return {"name": "block", "shape": {"box": {"size": size}}, "position": [0, 0, 0.1 - size[2] / 2],
            "motion": "fixed", "material": material} | more  # fmt: skip


def models(*bodies: dict[str, object], **keys: object) -> tuple[list[str], list[str]]:
    """Models of a case's bodies after `load_aware`, and its notes."""
    case, notes = load_aware(Case.model_validate({"bodies": list(bodies), **keys}), Path(), INVISIBLE)
    return [body.model for body in case.bodies], notes


@pytest.mark.parametrize(("share", "model", "count"), [(1.02, "rigid", 1), (0.98, "auto", 0)])
def test_a_block_is_rigid_where_hertz_says_that_its_dent_is_below_the_bound(share, model, count):
    """On either side of the stiffness at which a 1 kg ball sinks in by exactly the bound; a note names the body."""
    found, notes = models(block([0.2, 0.2, 0.1], share * LIMIT), BALL)
    assert found == [model, "auto"]
    assert len(notes) == count
    assert all("block is treated as rigid" in note for note in notes)


def test_what_is_asked_to_be_soft_stays_soft():
    """`model: mpm` wins."""
    assert models(block([0.2, 0.2, 0.1], 9e8, model="mpm"), BALL)[0][0] == "mpm"


def test_a_bar_that_bends_stays_soft():
    """Hertz sees no dent in it, but clamped at one end it gives 4 W l^3 / (E b t^3) = 0.26 m at 9e8 Pa."""
    bar = [0.4, 0.05, 0.006]
    assert models(block(bar, 9e8, clamp="x_min"), BALL)[0][0] == "auto"
    assert models(block(bar, 9e8, clamp="bottom"), BALL)[0][0] == "rigid"


@pytest.mark.slow
def test_a_drop_says_what_it_treated_as_rigid(tmp_path):
    """The result warns and has no particles."""
    cube = BALL | {"shape": {"box": {"size": [0.1, 0.1, 0.1]}}}
    path = tmp_path / "case.yaml"
    path.write_text(json.dumps({"bodies": [block([0.2, 0.2, 0.1], 9e8), cube]}))
    result: Any = run_case(path, tmp_path / "out", load_aware=True, quiet=True)
    assert result["verdict"] == "at_rest"
    assert result["particles"] == 0
    assert any("block is treated as rigid" in str(one) for one in result["warnings"])
