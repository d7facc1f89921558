"""Writes scene.json and deformed_N.ply: facts of a scene for the next placement, besides its geometry.

Same scene, same bytes. `dcap.scene.readers.scenes.placed_scene` has the schema and reads them.
"""

import json

import numpy as np
from numpy.typing import NDArray

from dcap.scene.readers.scenes.placed_scene import (
    FACTS,
    SHIFT,
    VERSION,
    BoxEntry,
    DeformationEntry,
    InstanceEntry,
    LayerEntry,
    MaterialEntry,
    PartEntry,
    PlacedEntry,
    SceneFile,
)
from dcap.scene.types.box import OrientedBox
from dcap.scene.types.earlier import Deformation, EarlierPlacements
from dcap.scene.types.materials import PartMaterial
from dcap.scene.types.segmentation import Instance
from dcap.scene.writers.ply import ply_bytes


def placed_scene_files_of(
    earlier: EarlierPlacements, last: str | None, last_parts: NDArray[np.integer] | None
) -> dict[str, bytes]:
    """The files by name. `last` is the thing of the node `object` in scene.glb, `last_parts` the part of each face of
    object.ply, shape (m,)."""
    names = [f"deformed_{number}.ply" for number in range(1, len(earlier.deformations) + 1)]
    facts = SceneFile(
        version=VERSION,
        up="z",
        unit="m",
        object=last,
        instances=[instance_entry(one, earlier, last_parts if one.id == last else None) for one in earlier.instances],
        touching=list(earlier.touching),
        deformations=[
            DeformationEntry(
                instance=one.instance, loads=list(one.loads), file=name,
                largest_m=round(float(np.linalg.norm(one.shift, axis=1).max(initial=0.0)), 6),
            )
            for one, name in zip(earlier.deformations, names, strict=True)
        ],
    )  # fmt: skip
    text = json.dumps(facts.model_dump(mode="json", exclude_none=False), indent=2, allow_nan=False, ensure_ascii=False)
    surfaces = {
        name: deformed_ply(one) for name, one in zip(names, earlier.deformations, strict=True)
    }  # fmt: skip
    return {FACTS: (text + "\n").encode(), **surfaces}


def deformed_ply(one: Deformation) -> bytes:
    """A surface under its loads, with its shift."""
    vertex = {"x y z": one.surface.vertices, " ".join(SHIFT): one.shift}
    face = {"list vertex_indices": one.surface.faces.astype(np.int32, copy=False)}
    return ply_bytes({"vertex": vertex, "face": face}, ["metres, right-handed, z up"])


def instance_entry(one: Instance, earlier: EarlierPlacements, parts: NDArray[np.integer] | None) -> InstanceEntry:
    """An instance in the file's form."""
    materials = {(row.part_index): row for row in earlier.materials if row.body == one.id}
    thing = earlier.thing(one.id)
    return InstanceEntry(
        id=one.id,
        label=one.label,
        structure=one.structure,
        confidence=one.confidence,
        guesses=list(one.guesses),
        front=None if one.front is None else one.front.tolist(),
        box=box_entry(one.box),
        parts=[
            PartEntry(
                name=part.name, confidence=part.confidence, box=box_entry(part.box),
                material=material_entry(materials[index]) if index in materials else None,
                faces=None if parts is None else runs_of(parts == index),
            )
            for index, part in enumerate(one.parts)
        ],
        placed=None if thing is None else PlacedEntry(
            mass=thing.mass, carried_by=list(thing.carried_by), prompt=thing.prompt
        ),
    )  # fmt: skip


def box_entry(box: OrientedBox) -> BoxEntry:
    """A box in the file's form."""
    return BoxEntry(center=box.center.tolist(), axes=box.axes.tolist(), half_extents=box.half_extents.tolist())


def material_entry(row: PartMaterial) -> MaterialEntry:
    """A part's material in the file's form."""
    m = row.material
    layers = None
    if m.layers is not None:
        layers = LayerEntry(
            youngs_modulus=m.layers.youngs_modulus,
            poisson_ratio=m.layers.poisson_ratio,
            shear_modulus=m.layers.shear_modulus,
        )
    return MaterialEntry(
        id=m.id, model=row.model.value, density=m.density, youngs_modulus=m.youngs_modulus,
        poisson_ratio=m.poisson_ratio, static_friction=m.static_friction, dynamic_friction=m.dynamic_friction,
        rolling_resistance=m.rolling_resistance, kind=m.kind, source=m.source, reason=row.reason, layers=layers,
    )  # fmt: skip


def runs_of(mine: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Runs of true values: first and one past the last."""
    step = np.diff(np.concatenate([[0], mine.astype(np.int8), [0]]))
    return list(zip(np.flatnonzero(step == 1).tolist(), np.flatnonzero(step == -1).tolist(), strict=True))
