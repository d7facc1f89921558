"""Properties of a face's material beyond its base colour: transparency, factors and further images.

Names, defaults and meanings are those of Khronos, "glTF 2.0 Specification", section 3.9 (materials).
"""

from dataclasses import dataclass
from enum import StrEnum


class AlphaMode(StrEnum):
    """Meaning of the alpha of a base colour."""

    OPAQUE = "OPAQUE"
    """Ignored."""
    MASK = "MASK"
    """Texels below the cutoff are cut away."""
    BLEND = "BLEND"
    """Blends the surface with the background."""


@dataclass(frozen=True, slots=True)
class MaterialMap:
    """A further image of a material."""

    texture: int
    """Index into the paint's textures."""
    uv_set: int = 0
    """Set of texture coordinates: 0 for those of the base colour, else one more than the index into `more_uv`."""
    strength: float = 1.0
    """Scale of a normal map, strength of an occlusion map; 1 for others [-]."""


@dataclass(frozen=True, slots=True)
class SurfaceMaterial:
    """A material of a file; its base colour is in the paint."""

    name: str = ""
    alpha_mode: AlphaMode = AlphaMode.OPAQUE
    alpha_cutoff: float = 0.5
    """Least visible alpha with `MASK` [-]."""
    alpha: float = 1.0
    """Factor of the texture's alpha, 0..1 [-]."""
    metallic: float | None = None
    """Factor 0..1 [-]; None: not stated in the file."""
    roughness: float | None = None
    """Factor 0..1 [-]; None: not stated in the file."""
    emission: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Linear factor 0..1 of its emitted light."""
    double_sided: bool | None = None
    """Whether back faces are visible; None: not stated in the file."""
    metallic_roughness_map: MaterialMap | None = None
    """Roughness in green, metalness in blue, both linear."""
    normal_map: MaterialMap | None = None
    """Tangent-space normals, linear."""
    occlusion_map: MaterialMap | None = None
    """Ambient occlusion in red, linear."""
    emissive_map: MaterialMap | None = None
    """Emitted light, sRGB."""

    @property
    def maps(self) -> tuple[MaterialMap, ...]:
        """Its further images."""
        each = (self.metallic_roughness_map, self.normal_map, self.occlusion_map, self.emissive_map)
        return tuple(one for one in each if one is not None)


PLAIN = SurfaceMaterial()
"""Material of a face with nothing but a colour."""
