"""Cloth and pillows as cases: rows of materials.csv that droop, sag and touch as a whole."""

import json
from typing import Any

import numpy as np
import pytest
import trimesh

from dcap.knowledge.material_table import load_materials
from tasks.case.run import run_case

FOAM = {"density": 35, "youngs_modulus": 8e4, "poisson_ratio": 0.3, "static_friction": 0.7, "dynamic_friction": 0.6}


def dropped(folder, *bodies: dict[str, Any]):
    """result.json of a case, and the vertices of its first body at rest (n, 3) [m]."""
    path = folder / "case.yaml"
    path.write_text(json.dumps({"bodies": bodies}))
    result: Any = run_case(path, folder / "out", threads=2, quiet=True)
    assert result["verdict"] == "at_rest"
    settled: Any = trimesh.load(folder / "out" / f"{bodies[0]['name']}.ply", process=False)
    return result, np.asarray(settled.vertices)


def box(name, size, position, material, **more):
    """A box of a case."""
    return {"name": name, "shape": {"box": {"size": size}}, "position": position, "material": material, **more}


GAP, HIGH, WIDE = 0.12, 0.12, 0.4  # between the cushions, and of the pillow [m]


def sag_of_pillow(folder, material):
    """How far a pillow sags into the gap between two seat cushions [m], and the areas that it touches them with."""
    cushions = [
        box(name, [0.4, 0.5, 0.15], [side * (0.2 + GAP / 2), 0, -0.075], FOAM, motion="fixed")
        for name, side in (("left", -1), ("right", 1))
    ]
    result, now = dropped(folder, box("pillow", [0.6, WIDE, HIGH], [0, 0, HIGH / 2 + 0.002], material), *cushions)
    under = now[now[:, 2] < HIGH / 2]
    middle = np.abs(under[:, 0]) < 0.005
    return -float(under[middle, 2].min()), [contact["area_m2"] for contact in result["contacts"]]


@pytest.mark.slow
@pytest.mark.long
def test_a_pillow_sags_into_the_gap_between_two_cushions(tmp_path):
    """Its layers slip by about rho g L^2 / (8 G), three times the sag of an isotropic block; it lies on either cushion
    with all that is over it."""
    row = load_materials()["pillow_polyester"]
    assert row.layers is not None
    sag, areas = sag_of_pillow(tmp_path, "pillow_polyester")
    slip = row.density * 9.81 * GAP**2 / (8.0 * row.layers.shear_modulus)
    assert 0.7 * slip < sag < 1.5 * slip  # edges of foam give, and the stiffness along the layers takes from the slip
    # one patch each: next to nothing of the overlap is left out
    assert sorted(areas)[0] > 0.9 * WIDE * (0.3 - GAP / 2)
    block = {"density": row.density, "youngs_modulus": row.youngs_modulus, "poisson_ratio": row.poisson_ratio,
             "static_friction": row.static_friction, "dynamic_friction": row.dynamic_friction}  # fmt: skip
    (tmp_path / "block").mkdir()
    assert sag_of_pillow(tmp_path / "block", block)[0] < sag / 3.0


@pytest.mark.slow
@pytest.mark.sweep
def test_a_towel_hangs_over_the_rim_of_a_round_stool(tmp_path):
    """Over the seat it lies on it, and its corners hang below: at rest, with no part of the middle in the air."""
    radius, size = 0.14, [0.32, 0.26, 0.05]
    stool = {"name": "stool", "shape": {"cylinder": {"radius": radius, "height": 0.03}}, "position": [0, 0, -0.015],
             "motion": "fixed", "material": "wood_beech"}  # fmt: skip
    _, now = dropped(tmp_path, box("towel", size, [0, 0, 0.027], "towel_stack"), stool)
    under = now[now[:, 2] < 0.02]
    inside = np.hypot(under[:, 0], under[:, 1]) < radius
    assert (np.abs(under[inside, 2]) < 2e-3).mean() >= 0.7
    corners = [0.5 * np.array([x * size[0], y * size[1]]) for x in (-1, 1) for y in (-1, 1)]
    lowest = [now[np.hypot(*(now[:, :2] - corner).T) < 0.02, 2].min() for corner in corners]
    assert max(lowest) < -2e-3
