"""A piece of furniture or an object: labelled, made of named parts, each of one or more closed solids."""

from dataclasses import dataclass, replace

import numpy as np

from dcap.scene.types.mesh import Mesh
from dcap.synthetic.shapes import Array, rotation


@dataclass(frozen=True, eq=False, slots=True)
class SolidPart:
    """A named part."""

    name: str
    """Part name in lower case, as listed in `dcap.scene.types.segmentation.Part`."""
    solids: tuple[Mesh, ...]
    """Closed solids; they may pass into each other and into other parts."""


@dataclass(frozen=True, eq=False, slots=True)
class Assembly:
    """One instance. Furniture: origin on the floor below the middle, front towards +y."""

    label: str
    """Category as in InteriorGS, lower case."""
    parts: tuple[SolidPart, ...]

    @property
    def bounds(self) -> Array:
        """Axis-aligned bounds [m], shape (2, 3)."""
        bounds = np.array([solid.bounds for part in self.parts for solid in part.solids])
        return np.stack([bounds[:, 0].min(axis=0), bounds[:, 1].max(axis=0)])

    def placed(self, x: float = 0.0, y: float = 0.0, z: float = 0.0, yaw_deg: float = 0.0) -> "Assembly":
        """The piece turned about the vertical and then shifted [m]."""
        pose = np.eye(4)
        pose[:3, :3] = rotation("z", yaw_deg)
        pose[:3, 3] = x, y, z
        return self.transformed(pose)

    def transformed(self, pose: Array) -> "Assembly":
        """The piece under a 4x4 rigid map."""
        moved = tuple(replace(p, solids=tuple(s.transformed(pose) for s in p.solids)) for p in self.parts)
        return replace(self, parts=moved)


def assembly(label: str, **parts: Mesh | list[Mesh]) -> Assembly:
    """Shorthand: part names as keywords, underscores standing for spaces; a list for several solids."""
    named = ((name.replace("_", " "), m if isinstance(m, list) else [m]) for name, m in parts.items())
    return Assembly(label, tuple(SolidPart(name, tuple(solids)) for name, solids in named if solids))
