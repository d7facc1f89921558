"""Depth of a ball in a slab at the default resolution: laws that hold between masses and stiffnesses.

Static equilibrium of a weightless slab scales with E, so the depth depends on m g / E alone. Two values are known from
static finite elements; the laws below tie every other mass and stiffness to them.
"""

import json

import numpy as np
import pytest
import trimesh

from tasks.case import run_case

RADIUS, THICK, GRAVITY = 0.05, 0.15, 9.81
# depth [m] by E [Pa] for 1 kg, static finite elements (hex27, fixed-corotated energy, bonded slab 0.4 x 0.4 x 0.15 m)
KNOWN = {2e4: 12.166e-3, 5e5: 1.488e-3}
PENETRATION = 1.25 * 5e-5  # largest mean penetration that the solver leaves before it stiffens a contact [m]


def hertz_depth(mass, E):
    """(9 F^2 / (16 R E*^2))^(1/3) with nu = 0.3."""
    return (9 * (mass * GRAVITY) ** 2 / (16 * RADIUS * (E / 0.91) ** 2)) ** (1 / 3)


def drop(folder, mass, E, resolution="auto"):
    """result.json and depth [m] of the reference drop."""
    material = {"density": 200, "youngs_modulus": E, "poisson_ratio": 0.3, "static_friction": 0.5,
                "dynamic_friction": 0.4}  # fmt: skip
    case = {
        "resolution": resolution,
        "bodies": [
            {"name": "slab", "shape": {"box": {"size": [0.4, 0.4, THICK]}}, "position": [0, 0, THICK / 2],
             "motion": "fixed", "material": material},
            {"name": "ball", "shape": {"sphere": {"radius": RADIUS}}, "position": [0, 0, THICK + RADIUS + 0.01],
             "mass": mass, "material": "steel"},
        ],
    }  # fmt: skip
    folder.mkdir(exist_ok=True)
    path = folder / "case.yaml"
    path.write_text(json.dumps(case))
    result = run_case(path, folder / "out", threads=2, quiet=True)
    assert result["verdict"] == "at_rest"
    return result, THICK - result["bodies"]["ball"]["aabb"][0][2]


@pytest.mark.slow
@pytest.mark.sweep
def test_depth_depends_on_weight_over_stiffness_only(tmp_path):
    """(0.2 kg, 2e4 Pa), (1 kg, 1e5 Pa) and (5 kg, 5e5 Pa) sink equally deep."""
    depths = [drop(tmp_path / str(m), m, E)[1] for m, E in ((0.2, 2e4), (1.0, 1e5), (5.0, 5e5))]
    # the cells are the same; what may differ is the penetration, which is aimed at in metres
    assert np.ptp(depths) < PENETRATION
    # Hertz times what the slab's bottom and large strain make of it: a factor that lies between those of the two known
    # depths, which differ by 4 %
    factors = [KNOWN[E] / hertz_depth(1.0, E) for E in KNOWN]
    assert min(factors) < np.mean(depths) / hertz_depth(1.0, 1e5) < max(factors)


@pytest.mark.slow
@pytest.mark.sweep
@pytest.mark.parametrize(("mass", "E"), [(0.2, 1e4), (0.2, 5e5)])
def test_depth_lies_between_what_the_known_depths_leave(tmp_path, mass, E):
    """The factor on Hertz falls with the load: between the two known ones where m / E is between theirs, and between
    the upper one and 1 for smaller loads; 2 % is the promise for the depth."""
    depth = drop(tmp_path, mass, E)[1] / hertz_depth(mass, E)
    soft, stiff = (KNOWN[E] / hertz_depth(1.0, E) for E in (2e4, 5e5))
    low, high = (soft, stiff) if mass / E > 1.0 / 5e5 else (stiff, 1.0)
    assert 0.98 * low < depth < 1.02 * high


@pytest.mark.slow
@pytest.mark.sweep
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("mass", [0.2, 1.0, 5.0])
@pytest.mark.parametrize("E", [1e4, 2e4, 1e5, 5e5])
def test_the_default_resolution_is_fine_enough(tmp_path, mass, E):
    """Cells smaller by a third change the depth by less than the 2 % that the default promises."""
    result, depth = drop(tmp_path / "default", mass, E)
    finer = drop(tmp_path / "finer", mass, E, result["resolution"] / 1.5)[1]
    assert depth == pytest.approx(finer, rel=0.02)


@pytest.mark.slow
@pytest.mark.parametrize("E", sorted(KNOWN))
def test_the_surfaces_in_a_picture_neither_gape_nor_overlap(tmp_path, E):
    """Between the ball and the deformed surface as written to the PLY file: at most 0.3 mm anywhere in the contact."""
    result, depth = drop(tmp_path, 1.0, E)
    slab = trimesh.load(tmp_path / "out" / "slab.ply", process=False)
    center = np.array(result["bodies"]["ball"]["position"])
    points = np.concatenate([slab.vertices, slab.triangles_center])
    gap = np.linalg.norm(points - center, axis=1) - RADIUS
    # contact radius of Hertz, sqrt(R d), from which the known ones differ by less than 5 %: look inside of 0.8 of it
    under = (np.hypot(*(points - center)[:, :2].T) < 0.8 * np.sqrt(RADIUS * depth)) & (points[:, 2] > 0.5 * THICK)
    assert under.sum() > 30
    assert gap.min() > -3e-4
    assert gap[under].max() < 3e-4
