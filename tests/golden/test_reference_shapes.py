"""Shapes that rest on foam at default resolution, against static finite elements of the same contact, or much finer
cells."""

import json
from pathlib import Path
from typing import Any

import pytest

from tasks.case.run import run_case

JsonObject = dict[str, Any]
FRICTION = {"static_friction": 0.5, "dynamic_friction": 0.4}
FOAM = {"density": 200, "youngs_modulus": 5e4, "poisson_ratio": 0.3, **FRICTION}
LAID = [0.7071067811865476, 0.0, 0.7071067811865476, 0.0]


def block(name: str, height: float, bottom: float, material: JsonObject, **more: Any) -> JsonObject:
    """A block of 0.4 x 0.4 m."""
    shape = {"box": {"size": [0.4, 0.4, height]}}
    return {"name": name, "shape": shape, "position": [0, 0, bottom + height / 2], "material": material, **more}


def steel(shape: JsonObject, height: float, mass: float, **more: Any) -> JsonObject:
    """What comes to rest, its origin at a height [m]."""
    return {"name": "item", "shape": shape, "position": [0, 0, height], "mass": mass, "material": "steel", **more}


FIXED = {"motion": "fixed", "clamp": "bottom", "rest_shape": "loaded"}
SLAB = block("slab", 0.15, 0.0, FOAM, **FIXED)
CASES: dict[str, tuple[JsonObject, float, float, float]] = {
    "a flat cylinder": (
        {"bodies": [SLAB, steel({"cylinder": {"radius": 0.04, "height": 0.1}}, 0.21, 1.5)]}, 0.20, 0.002617, 0.015,
    ),
    # against its own depth on cells of 3.3 mm
    "a flat cylinder on a thin layer": (
        {
            "bodies": [
                block("slab", 0.04, 0.0, FOAM | {"youngs_modulus": 3e4}, **FIXED),
                steel({"cylinder": {"radius": 0.08, "height": 0.05}}, 0.0655, 8.96),
            ]
        },
        0.065, 0.00389, 0.04,
    ),
    "a lying capsule": (
        {"bodies": [SLAB, steel({"capsule": {"radius": 0.04, "length": 0.1}}, 0.2, 3.0, quaternion=LAID)]},
        0.19, 0.007092, 0.02,
    ),
    "a ball on a bonded cover": (
        {
            "bodies": [
                block("slab", 0.23, 0.0, {"density": 50, "youngs_modulus": 4e4, "poisson_ratio": 0.3, **FRICTION},
                      **FIXED),
                block("cover", 0.02, 0.23, {"density": 5, "youngs_modulus": 1.2e4, "poisson_ratio": 0.2, **FRICTION}),
                steel({"sphere": {"radius": 0.05}}, 0.31, 1.0),
            ],
            "bonds": [["cover", "slab"]],
        },
        0.30, 0.012547, 0.02,
    ),
}  # fmt: skip
"""Case, height of the origin where it just touches [m], depth [m], tolerance."""


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", [pytest.param(one, marks=[pytest.mark.long] * (one != "a flat cylinder")) for one in CASES]
)
def test_it_sinks_as_deep_as_the_reference(name: str, tmp_path: Path) -> None:
    """The cells follow the shape's own patch, and are finest where it ends at an edge."""
    case, top, depth, tolerance = CASES[name]
    path = tmp_path / "case.yaml"
    path.write_text(json.dumps(case))
    run_case(path, tmp_path / "out", quiet=True, threads=2)
    result = json.loads((tmp_path / "out" / "result.json").read_text())
    assert result["verdict"] == "at_rest"
    assert top - result["bodies"]["item"]["position"][2] == pytest.approx(depth, rel=tolerance)
