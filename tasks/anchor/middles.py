"""Aims on a part of several pieces: the middle of each piece, as there is no arm between the arms of a sofa."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from dcap.geometry.placement.named_regions import Region
from dcap.geometry.segmentation.faces import surface_pieces, surface_points
from dcap.scene.types.mesh import Mesh

LEVEL = 0.7
"""Least normal z of a carrying face in the middle of a piece [-]."""
PIECE = 0.3
"""Least share of the largest piece's surface that a piece has [-]."""
OVER = 0.05
"""Largest distance in plan of an aim over a piece [m]."""


def at_own_middles(mesh: Mesh, mask: NDArray[np.bool_], areas: Sequence[Region]) -> list[Region]:
    """The areas; one whose aim is over no carrying piece is repeated for each piece, aimed at the piece's middle.

    Args:
        mesh: the scene.
        mask: faces that may carry, shape (m,).
        areas: the areas.
    """
    faces = np.flatnonzero(mask & (mesh.face_normals[:, 2] > LEVEL * 2.0 * mesh.face_areas))
    if not len(faces):
        return list(areas)
    piece = surface_pieces(mesh, faces)
    area, center = mesh.face_areas[faces], mesh.triangles[faces].mean(axis=1)[:, :2]
    total = np.bincount(piece, area)
    large = np.flatnonzero(total > PIECE * total.max())
    middles = [np.average(center[piece == one], axis=0, weights=area[piece == one]) for one in large]
    tree = cKDTree(surface_points(mesh.triangles[faces], area, 0.5 * OVER)[0][:, :2])
    found = []
    for one in areas:
        between = len(middles) > 1 and tree.query(one.target)[0] > OVER
        found += [replace(one, target=middle) for middle in middles] if between else [one]
    return found
