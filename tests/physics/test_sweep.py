"""From 1 g to 50 kg on 1e4 to 9e8 Pa at the default resolution: nothing is thrown off and nothing falls through."""

import json

import numpy as np
import pytest

from tasks.case.run import run_case

DENSITY = 1000.0  # of the load, so that its size follows from its mass [kg/m^3]
WIDE, THICK = 10.0, 5.0  # sides and thickness of the slab over the load's half height
MASSES = [1e-3, 0.03, 1.0, 50.0]
MODULI = [1e4, 1e6, 1e8, 9e8]
FALL = 0.01


def body(shape, mass):
    """A ball or cube and half its height [m]."""
    volume = mass / DENSITY
    if shape == "ball":
        radius = float(np.cbrt(0.75 * volume / np.pi))
        return {"sphere": {"radius": radius}}, radius
    side = float(np.cbrt(volume))
    return {"box": {"size": [side] * 3}}, 0.5 * side


def settle(folder, shape, mass, E):
    """result.json of the body dropped on the middle of a foam block that is held at its bottom."""
    solid, half = body(shape, mass)
    wide, thick = WIDE * half, THICK * half
    material = {"density": 100, "youngs_modulus": E, "poisson_ratio": 0.3, "static_friction": 0.5,
                "dynamic_friction": 0.4, "rolling_resistance": 0.002}  # fmt: skip
    case = {
        "bodies": [
            {"name": "slab", "shape": {"box": {"size": [wide, wide, thick]}}, "position": [0, 0, thick / 2],
             "motion": "fixed", "material": material},
            {"name": "load", "shape": solid, "position": [0, 0, thick + half + FALL], "mass": mass,
             "material": "steel"},
        ],
    }  # fmt: skip
    path = folder / "case.yaml"
    path.write_text(json.dumps(case))
    return run_case(path, folder / "out", threads=2, quiet=True)


def check(folder, shape, mass, E):
    """It rests over its start place, in the slab but not through it, and the slab carries its weight."""
    result, half = settle(folder, shape, mass, E), body(shape, mass)[1]
    assert result["verdict"] == "at_rest"
    load = result["bodies"]["load"]
    depth = THICK * half - load["aabb"][0][2]
    # it fell straight: what is left is the kick of 1 mm/s, 0.01 rad/s for half a second, and rolling in that time
    assert np.hypot(*load["position"][:2]) < max(0.05 * half, 1e-3)
    assert 0.0 <= depth < THICK * half
    assert result["residual"]["force"] < 0.005
    return depth


@pytest.mark.slow
@pytest.mark.long
def test_a_cube_of_a_gram_rests_on_soft_foam(tmp_path):
    """The light and soft corner of the range."""
    check(tmp_path, "cube", 1e-3, 1e4)


@pytest.mark.slow
@pytest.mark.sweep
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("shape", ["ball", "cube"])
@pytest.mark.parametrize("mass", MASSES)
@pytest.mark.parametrize("E", MODULI)
def test_no_mass_is_thrown_off_or_falls_through_any_stiffness(tmp_path, shape, mass, E):
    """The whole range, logarithmically."""
    check(tmp_path, shape, mass, E)
