"""Properties of the materials of an OBJ beyond colours and diffuse textures, put on its faces."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from dcap.scene.readers.mesh.mtl import LIGHT, NORMAL, MtlMaterial
from dcap.scene.types.paint import Paint
from dcap.scene.types.surface_material import PLAIN, MaterialMap, SurfaceMaterial


def with_materials(
    paint: Paint,
    library: Mapping[str, MtlMaterial],
    line_material: NDArray[np.int32],
    names: tuple[str, ...],
    owner: NDArray[np.int64],
    has_uv: NDArray[np.bool_],
) -> Paint:
    """Paint of triangles that are parts of the face lines `owner` (m,), with the material of each line, an index into
    `names`, -1 for none. Images count on the triangles that have texture coordinates (m,)."""
    textures, flat, mapped = list(paint.textures), [], []
    for name in names:
        found = library.get(name, MtlMaterial())
        uses: dict[str, MaterialMap] = {}
        for keyword, image in found.images.items():
            uses[keyword] = MaterialMap(len(textures))
            textures.append(image)
        said = SurfaceMaterial(
            name=name, alpha_mode=found.alpha_mode, alpha=found.opacity, metallic=found.metallic,
            roughness=found.roughness, emission=found.emission,
        )  # fmt: skip
        flat.append(said)
        mapped.append(replace(said, normal_map=uses.get(NORMAL), emissive_map=uses.get(LIGHT)))
    materials = tuple(dict.fromkeys([PLAIN, *mapped, *flat]))
    number = {one: index for index, one in enumerate(materials)}
    with_uv, without = (np.array([number[one] for one in (*of, PLAIN)], dtype=np.int32) for of in (mapped, flat))
    face_material = line_material[owner]
    return replace(
        paint, textures=tuple(textures), face_material=np.where(has_uv, with_uv[face_material], without[face_material]),
        materials=materials,
    )  # fmt: skip
