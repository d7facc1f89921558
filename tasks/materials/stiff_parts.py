"""`dcap place --load-aware`: parts with an invisible deflection under the object's weight become rigid.

In: the chosen materials of the object's, the base's and the neighbours' parts. Out: the same with `rigid` if the
predicted deflection of a part of object or base is below a bound, with the reason, and a note for each.
"""

from dataclasses import replace

import numpy as np

from dcap.geometry.raycast import Raycaster
from dcap.scene.types.anchor import Anchor
from dcap.scene.types.gravity import GRAVITY
from dcap.scene.types.intent import Intent
from dcap.scene.types.materials import BodyModel, PartMaterial
from dcap.scene.types.segmentation import Segmentation
from solver.contact.predict import deflection
from tasks.bodies.footprint import first_curvature

OBJECT = "object"


def stiffened(
    rows: list[PartMaterial], scene: Segmentation, item: Segmentation, intent: Intent, anchor: Anchor, invisible: float
) -> tuple[list[PartMaterial], tuple[str, ...]]:
    """Make parts rigid that give less than `invisible` [m] under the object's weight.

    Hertz's indentation with the curvature of the object's underside, all of it in that one part; bending of a part of
    the object as a bar clamped at one end, of a part of the base as one as high as it is, since its bottom is held.
    """
    weight = intent.mass * GRAVITY
    base = scene.index_of(anchor.base_id)
    beneath = Raycaster(scene.mesh.submesh(np.flatnonzero(scene.face_instance == base)))
    mesh = item.mesh.transformed(anchor.world_from_object)
    radius = first_curvature(mesh, beneath, float(anchor.surface_point[2]))
    scale = float(np.linalg.norm(anchor.world_from_object[:3, 2]))
    changed, notes = [], []
    for row in rows:
        m = row.material
        if row.body == OBJECT:
            x, y, z = scale * 2.0 * item.instances[0].parts[row.part_index].box.half_extents
            thickness, width, length = sorted((float(x), float(y), float(z)))
        elif row.body == anchor.base_id:
            x, y, length = 2.0 * scene.instances[base].parts[row.part_index].box.half_extents
            thickness, width = sorted((float(x), float(y)))
        else:  # neighbours are rigid obstacles anyway
            changed.append(row)
            continue
        depth = deflection(weight, radius, (length, width, thickness), m.youngs_modulus, m.poisson_ratio)
        if row.model is BodyModel.MPM and depth < invisible:
            why = f"would give {1e3 * depth:.2g} mm under {weight:.3g} N, below {1e3 * invisible:.2g} mm (load-aware)"
            notes.append(f"{row.body}: {row.part} ({m.id}) is treated as rigid: it {why}")
            row = replace(row, model=BodyModel.RIGID, reason=f"{row.reason}; but it {why}: rigid")
        changed.append(row)
    return changed, tuple(notes)
