"""Several closed pieces as one solid.

In: closed pieces wound one way round, which may overlap, lie in one another or apart. Out: the surface of their union
(manifold3d), hollows kept. Pieces that do not meet are kept as they are.
"""

import manifold3d
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from dcap.geometry.pieces import inside_out_shells, signed_volume
from dcap.geometry.solid.repair_log import RepairKind, RepairLog
from dcap.geometry.solid.soundness import well_formed
from dcap.scene.types.mesh import Mesh

FINE = 1e-6  # edges that a union leaves shorter than this [m] are rounding and are collapsed


def united(pieces: list[Mesh], log: RepairLog) -> Mesh | None:
    """The union of closed pieces; None if one of them is not the border of a solid (a manifold).

    A piece that is wound inside out is a hollow if it lies in another, else it is turned.
    """
    turned = inside_out_shells(pieces)
    log.add(RepairKind.INVERTED, times=int(turned.sum()))
    pieces = [inside_out(p) if wrong else p for p, wrong in zip(pieces, turned, strict=True)]
    volume = [signed_volume(p.vertices, p.faces) for p in pieces]
    order = sorted(range(len(pieces)), key=lambda i: -abs(volume[i]))
    joined = Mesh.concatenate(pieces)
    if not any_meet(pieces) and well_formed(joined):
        return joined
    result = manifold3d.Manifold()
    for index in order:
        hollow = volume[index] < 0.0
        one = manifold_of(inside_out(pieces[index]) if hollow else pieces[index])
        if one.status() != manifold3d.Error.NoError:
            return None
        result = result - one if hollow else result + one
    log.add(RepairKind.UNITED, times=len(pieces) if len(pieces) > 1 else 0)
    return mesh_of(result.simplify(FINE), pieces)


def inside_out(mesh: Mesh) -> Mesh:
    """The mesh with its faces turned."""
    return Mesh(mesh.vertices, mesh.faces[:, ::-1].copy(), mesh.colors)


def any_meet(pieces: list[Mesh]) -> bool:
    """Whether the boxes of any two pieces overlap."""
    low, high = np.array([p.bounds[0] for p in pieces]), np.array([p.bounds[1] for p in pieces])
    overlap = ((low[:, None] <= high[None]) & (low[None] <= high[:, None])).all(axis=2)
    return bool(overlap.sum() > len(pieces))


def manifold_of(mesh: Mesh) -> manifold3d.Manifold:
    """The same as a manifold in double precision."""
    return manifold3d.Manifold(manifold3d.Mesh64(mesh.vertices, mesh.faces.astype(np.uint64)))


def mesh_of(solid: manifold3d.Manifold, painted: list[Mesh]) -> Mesh:
    """A manifold as our mesh, each vertex in the colour of the nearest painted one."""
    found = solid.to_mesh64()
    vertices: NDArray[np.float64] = np.array(found.vert_properties, dtype=np.float64)[:, :3]
    faces = np.asarray(found.tri_verts, dtype=np.int64)
    paint = Mesh.concatenate(painted)
    if len(vertices) == 0:
        return Mesh.of(vertices, faces)
    return Mesh.of(vertices, faces, paint.colors[cKDTree(paint.vertices).query(vertices)[1]])
