"""Depth of a ball in a slab at the default resolution: laws that hold between masses and stiffnesses.

Static equilibrium of a weightless slab scales with E, so the depth depends on m g / E alone. Two values are known from
static finite elements; the laws below tie every other mass and stiffness to them.
"""

import numpy as np
import pytest
import trimesh

PENETRATION = 1.25 * 5e-5  # largest mean penetration that the solver leaves before it stiffens a contact [m]


def hertz_depth(lab, mass, E):
    """(9 F^2 / (16 R E*^2))^(1/3) with nu = 0.3."""
    return (9 * (mass * lab.gravity) ** 2 / (16 * lab.radius * (E / 0.91) ** 2)) ** (1 / 3)


@pytest.mark.slow
@pytest.mark.sweep
def test_depth_depends_on_weight_over_stiffness_only(lab, tmp_path):
    """(0.2 kg, 2e4 Pa), (1 kg, 1e5 Pa) and (5 kg, 5e5 Pa) sink equally deep."""
    depths = [lab.reference_drop(tmp_path / str(m), m, E)[1] for m, E in ((0.2, 2e4), (1.0, 1e5), (5.0, 5e5))]
    # the cells are the same; what may differ is the penetration, which is aimed at in metres
    assert np.ptp(depths) < PENETRATION
    # Hertz times what the slab's bottom and large strain make of it: a factor that lies between those of the two known
    # depths, which differ by 4 %
    factors = [lab.known_depth[E] / hertz_depth(lab, 1.0, E) for E in lab.known_depth]
    assert min(factors) < np.mean(depths) / hertz_depth(lab, 1.0, 1e5) < max(factors)


@pytest.mark.slow
@pytest.mark.sweep
@pytest.mark.parametrize(("mass", "E"), [(0.2, 1e4), (0.2, 5e5)])
def test_depth_lies_between_what_the_known_depths_leave(lab, tmp_path, mass, E):
    """The factor on Hertz falls with the load: between the two known ones where m / E is between theirs, and between
    the upper one and 1 for smaller loads; 2 % is the promise for the depth."""
    depth = lab.reference_drop(tmp_path, mass, E)[1] / hertz_depth(lab, mass, E)
    soft, stiff = (lab.known_depth[E] / hertz_depth(lab, 1.0, E) for E in (2e4, 5e5))
    low, high = (soft, stiff) if mass / E > 1.0 / 5e5 else (stiff, 1.0)
    assert 0.98 * low < depth < 1.02 * high


@pytest.mark.slow
@pytest.mark.sweep
@pytest.mark.timeout(1800)
@pytest.mark.parametrize("mass", [0.2, 1.0, 5.0])
@pytest.mark.parametrize("E", [1e4, 2e4, 1e5, 5e5])
def test_the_default_resolution_is_fine_enough(lab, tmp_path, mass, E):
    """Cells smaller by a third change the depth by less than the 2 % that the default promises."""
    result, depth = lab.reference_drop(tmp_path / "default", mass, E)
    finer = lab.reference_drop(tmp_path / "finer", mass, E, result["resolution"] / 1.5)[1]
    assert depth == pytest.approx(finer, rel=0.02)


@pytest.mark.slow
@pytest.mark.parametrize("E", [2e4, pytest.param(5e5, marks=pytest.mark.long)])
def test_the_surfaces_in_a_picture_neither_gape_nor_overlap(lab, tmp_path, E):
    """Between the ball and the deformed surface as written to the PLY file: at most 0.3 mm anywhere in the contact."""
    result, depth = lab.reference_drop(tmp_path, 1.0, E)
    slab = trimesh.load_mesh(tmp_path / "out" / "slab.ply", process=False)
    center = np.array(result["bodies"]["ball"]["position"])
    points = np.concatenate([slab.vertices, slab.triangles_center])
    gap = np.linalg.norm(points - center, axis=1) - lab.radius
    # contact radius of Hertz, sqrt(R d), from which the known ones differ by less than 5 %: look inside of 0.8 of it
    under = (np.hypot(*(points - center)[:, :2].T) < 0.8 * np.sqrt(lab.radius * depth)) & (
        points[:, 2] > 0.5 * lab.thick
    )
    assert under.sum() > 30
    assert gap.min() > -3e-4
    assert gap[under].max() < 3e-4
