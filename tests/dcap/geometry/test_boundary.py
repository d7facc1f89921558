"""Vertices that are one place."""

import numpy as np
import trimesh

from dcap.geometry.pieces import welded


def test_welding_joins_what_an_exact_grouping_joins() -> None:
    """The hash of positions parts vertices as the four times slower exact grouping of trimesh does."""
    rng = np.random.default_rng(0)
    points = rng.integers(0, 40, (60_000, 3)) * 1e-3 + 1e-8 * rng.standard_normal((60_000, 3)) + (3.0, -7.0, 1.0)
    ours, theirs = welded(points), trimesh.grouping.unique_rows(points, digits=6)[1]
    pairs = np.unique(np.c_[ours, theirs], axis=0)
    assert len(pairs) == len(np.unique(ours)) == len(np.unique(theirs))
