"""Which part of the object is where."""

import numpy as np
from numpy.typing import NDArray

from dcap.geometry.boundary import is_closed
from dcap.geometry.distance import MeshDistance
from dcap.geometry.solid.repair import volume as mesh_volume
from dcap.scene.types.mesh import Mesh

Array = NDArray[np.float64]


def nearest_part(mesh: Mesh, part_of_face: NDArray[np.int32], points: Array) -> NDArray[np.int64]:
    """Part whose surface is nearest to each point (n, 3), shape (n,)."""
    return part_of_face[MeshDistance(mesh).nearest_face(points)].astype(np.int64)


def part_at(mesh: Mesh, part_of_face: NDArray[np.int32], points: Array) -> NDArray[np.int64]:
    """Part of an object that each point belongs to, shape (n,): the smallest closed one around it, else the nearest."""
    owner = nearest_part(mesh, part_of_face, points)
    parts = [(one, mesh.submesh(np.flatnonzero(part_of_face == one))) for one in np.unique(part_of_face).tolist()]
    closed = [(mesh_volume(piece), one, MeshDistance(piece)) for one, piece in parts if is_closed(piece)]
    if len(parts) > 1:
        for _, one, piece_field in sorted(closed, key=lambda c: -c[0]):
            owner[piece_field.inside(points)] = one
    return owner
