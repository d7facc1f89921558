"""Indentation depths in foam by each method, compared with static finite elements: a Markdown table.

python -m perf.references [--methods tl,mls,paper]

A cell has the depth over that of the reference, less one, and the time of the drop. `paper` is mls with the paper's
steps; the paper's clamps would change several cases, so they are left out.
"""

import argparse
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from flows.methods import PAPER_STEP_SECONDS
from tasks.case.run import run_case

JsonObject = dict[str, Any]
FRICTION = {"static_friction": 0.5, "dynamic_friction": 0.4}
FOAM = {"density": 200, "youngs_modulus": 5e4, "poisson_ratio": 0.3, **FRICTION}
LAID = [0.7071067811865476, 0.0, 0.7071067811865476, 0.0]
METHODS: dict[str, JsonObject] = {
    "tl": {"solver": "tl"},
    "mls": {"solver": "mls"},
    "paper": {"solver": "mls", "settings": {"mls_step_seconds": PAPER_STEP_SECONDS}},
}


@dataclass(frozen=True, slots=True)
class Reference:
    """A body that rests on foam, with its reference depth."""

    case: JsonObject
    top: float
    """Height of its origin where it just touches [m]."""
    depth: float
    """By static finite elements [m]; of the thin layer by tl on cells of 3.3 mm."""
    tolerance: float
    """By tl on default cells, relative to the depth [-]."""


def block(name: str, height: float, bottom: float, material: JsonObject, **more: Any) -> JsonObject:
    """A block of 0.4 x 0.4 m."""
    shape = {"box": {"size": [0.4, 0.4, height]}}
    return {"name": name, "shape": shape, "position": [0, 0, bottom + height / 2], "material": material, **more}


def steel(shape: JsonObject, height: float, mass: float, **more: Any) -> JsonObject:
    """The body that comes to rest, with its origin at a height [m]."""
    return {"name": "item", "shape": shape, "position": [0, 0, height], "mass": mass, "material": "steel", **more}


FIXED = {"motion": "fixed", "clamp": "bottom", "rest_shape": "loaded"}
SLAB = block("slab", 0.15, 0.0, FOAM, **FIXED)


def ball_on_slab(modulus: float) -> JsonObject:
    """1 kg, radius 5 cm."""
    slab = block("slab", 0.15, 0.0, FOAM | {"youngs_modulus": modulus}, **FIXED)
    return {"bodies": [slab, steel({"sphere": {"radius": 0.05}}, 0.21, 1.0)]}


REFERENCES: dict[str, Reference] = {
    "a ball, E 2e4": Reference(ball_on_slab(2e4), 0.20, 0.012166, 0.01),
    "a ball, E 5e5": Reference(ball_on_slab(5e5), 0.20, 0.001488, 0.01),
    "a flat cylinder": Reference(
        {"bodies": [SLAB, steel({"cylinder": {"radius": 0.04, "height": 0.1}}, 0.21, 1.5)]}, 0.20, 0.002617, 0.015,
    ),
    "a flat cylinder on a thin layer": Reference(
        {
            "bodies": [
                block("slab", 0.04, 0.0, FOAM | {"youngs_modulus": 3e4}, **FIXED),
                steel({"cylinder": {"radius": 0.08, "height": 0.05}}, 0.0655, 8.96),
            ]
        },
        0.065, 0.00389, 0.04,
    ),
    "a lying capsule": Reference(
        {"bodies": [SLAB, steel({"capsule": {"radius": 0.04, "length": 0.1}}, 0.2, 3.0, quaternion=LAID)]},
        0.19, 0.007092, 0.02,
    ),
    "a ball on a bonded cover": Reference(
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


def depth_of(result: JsonObject, one: Reference) -> float:
    """Depth of the item in the foam [m]."""
    return float(one.top - result["bodies"]["item"]["position"][2])


def cell_of(one: Reference, method: str) -> str:
    """Outcome of one case by one method."""
    with tempfile.TemporaryDirectory() as folder:
        result: JsonObject = run_case(one.case, Path(folder), quiet=True, threads=2, **METHODS[method])
    if result["verdict"] != "at_rest":
        return str(result["verdict"])
    return f"{100 * (depth_of(result, one) / one.depth - 1):+.1f} %, {result['wall_s']:.0f} s"


def main(arguments: list[str]) -> None:
    """Print the table, a row as soon as it is known."""
    parser = argparse.ArgumentParser(prog="python -m perf.references", description=__doc__)
    parser.add_argument("--methods", default="tl,mls,paper", help="between commas")
    methods = parser.parse_args(arguments).methods.split(",")
    sys.stdout.write(f"| case | depth | {' | '.join(methods)} |\n|{' --- |' * (len(methods) + 2)}\n")
    for name, one in REFERENCES.items():
        cells = [cell_of(one, method) for method in methods]
        sys.stdout.write(f"| {name} | {1e3 * one.depth:.2f} mm | {' | '.join(cells)} |\n")
        sys.stdout.flush()


if __name__ == "__main__":
    main(sys.argv[1:])
