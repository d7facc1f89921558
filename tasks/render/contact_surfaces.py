"""Contact patches as surfaces with their loads, one for each pair that touches.

In: the settled state. Out: nodes of a file: the faces of the object's surface where it is carried, cut fine enough to
follow the patch, with the area, force and mean pressure that the drop found.
"""

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
SAME = 1e-6
"""A contact point this near to a corner of the surface is that corner [m]."""


def contact_nodes(settled: Settled) -> list[Node]:
    """A node for each pair of which the object is one; empty where nothing touches it."""
    own, points = settled.bodies[0], settled.contact_points
    rows = [row for row in settled.contacts if own.name in (row.a, row.b)]
    if not len(points) or not rows:
        return [Node("contacts")]
    patch = patch_of(own.surface, points)
    others = [row.b if row.a == own.name else row.a for row in rows]
    known = {body.name: body.surface for body in settled.bodies}
    away = np.stack([Raycaster(known[name]).distance_to(patch.triangles.mean(axis=1)) for name in others])
    nearest = away.argmin(axis=0)
    children = []
    for number, (row, other) in enumerate(zip(rows, others, strict=True)):
        mine = patch.submesh(np.flatnonzero(nearest == number))
        children.append(Node(f"{own.name} on {other}", mine, label=f"contact with {other}", extras=loads(row)))
    return [Node("contacts", children=tuple(children))]


def patch_of(surface: Mesh, points: Array) -> Mesh:
    """The part of a surface that lies at contact points (k, 3): faces of which every corner is one, and what of the
    others is near a point."""
    tree, radius = cKDTree(points), patch_radius(points)
    carried = tree.query(surface.vertices, distance_upper_bound=SAME)[0] <= SAME
    whole = carried[surface.faces].all(axis=1)
    rest = surface.submesh(np.flatnonzero(~whole))
    patch = [surface.submesh(np.flatnonzero(whole))]
    if len(rest.faces):
        box = np.stack([points.min(axis=0) - radius, points.max(axis=0) + radius])
        fine = subdivide_near(rest, box, 2.0 * radius)
        middle = fine.triangles.mean(axis=1)
        close = tree.query(middle, distance_upper_bound=radius, workers=-1)[0] <= radius
        patch.append(fine.submesh(np.flatnonzero(close)))
    joined = Mesh.concatenate(patch)
    return Mesh.of(joined.vertices, joined.faces, COLOR)


def loads(row: ContactRow) -> dict[str, object]:
    """What a contact carries: SI units."""
    pressure = row.normal_force_n / row.area_m2 if row.area_m2 > 0.0 else 0.0
    return {
        "area_m2": row.area_m2,
        "normal_force_n": row.normal_force_n,
        "tangential_force_n": row.tangential_force_n,
        "mean_pressure_pa": pressure,
    }
