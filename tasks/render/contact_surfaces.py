"""Contact patches as surfaces with their loads, one for each pair that touches.

In: the settled state. Out: nodes of a file: the parts of the object's finely cut surface nearest to the contact points,
as large as the area in the drop, with that area, force and mean pressure.
"""

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from dcap.geometry.raycast import Raycaster
from dcap.geometry.solid.repair import subdivide_near
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.settled import Settled
from dcap.scene.writers.glb import Node
from solver.certificate import ContactRow
from tasks.render.patch import patch_radius

Array = NDArray[np.float64]

COLOR = (255, 122, 26)
REACH = 4.0
"""Reach of a patch from its contact point, over the radius of the disc that the point represents [-]."""
SAME = 1e-6
"""Distance within which a contact point is a corner of the surface [m]."""


def contact_nodes(settled: Settled) -> list[Node]:
    """A node for each pair with the object; empty if nothing touches it."""
    own, points = settled.bodies[0], settled.contact_points
    rows = [row for row in settled.contacts if own.name in (row.a, row.b)]
    if not len(points) or not rows:
        return [Node("contacts")]
    surface, away = near_points(own.surface, points)
    others = [row.b if row.a == own.name else row.a for row in rows]
    nearest = nearest_body(settled, others, surface) if len(others) > 1 else np.zeros(len(away))
    children = []
    for number, (row, other) in enumerate(zip(rows, others, strict=True)):
        faces = patch_faces(surface, np.where(nearest == number, away, np.inf), row.area_m2)
        patch = surface.submesh(faces)
        colored = Mesh.of(patch.vertices, patch.faces, COLOR)
        children.append(Node(f"{own.name} on {other}", colored, label=f"contact with {other}", extras=loads(row)))
    return [Node("contacts", children=tuple(children))]


def nearest_body(settled: Settled, names: Sequence[str], surface: Mesh) -> NDArray[np.int64]:
    """Return the number of the named body that each face (m,) of a surface is nearest to."""
    known = {body.name: body.surface for body in settled.bodies}
    middle = surface.triangles.mean(axis=1)
    distances = np.stack([Raycaster(known[name]).distance_to(middle) for name in names])
    return np.asarray(distances.argmin(axis=0), dtype=np.int64)


def near_points(surface: Mesh, points: Array) -> tuple[Mesh, Array]:
    """A surface cut finely near contact points (k, 3), and the distance of each of its faces from one [m], shape (m,);
    not cut if every contact point is a corner."""
    tree, radius = cKDTree(points), patch_radius(points)
    box = np.stack([points.min(axis=0) - REACH * radius, points.max(axis=0) + REACH * radius])
    carried = (tree.query(surface.vertices, distance_upper_bound=SAME)[0] <= SAME)[surface.faces].all(axis=1)
    whole, rest = surface.submesh(np.flatnonzero(carried)), surface.submesh(np.flatnonzero(~carried))
    fine = subdivide_near(rest, box, radius) if len(rest.faces) else rest
    away = tree.query(fine.triangles.mean(axis=1), distance_upper_bound=REACH * radius, workers=-1)[0]
    return Mesh.concatenate([whole, fine]), np.concatenate([np.zeros(len(whole.faces)), away])


def patch_faces(surface: Mesh, away: Array, area: float) -> NDArray[np.int64]:
    """The faces nearest to contact points, away (m,) [m] (inf: too far), that make up the area that the drop found
    [m^2]; at least one."""
    order = np.argsort(away, kind="stable")
    order = order[np.isfinite(away[order])]
    total = np.cumsum(surface.face_areas[order])
    return np.sort(order[: int(np.searchsorted(total, area)) + 1])


def loads(row: ContactRow) -> dict[str, object]:
    """Loads of a contact, in SI units."""
    pressure = row.normal_force_n / row.area_m2 if row.area_m2 > 0.0 else 0.0
    return {
        "area_m2": row.area_m2,
        "normal_force_n": row.normal_force_n,
        "tangential_force_n": row.tangential_force_n,
        "mean_pressure_pa": pressure,
    }
