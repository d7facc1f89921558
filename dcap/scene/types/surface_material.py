"""What the material of a face says beyond its base colour: transparency, factors and further images.

Names, defaults and meanings are those of Khronos, "glTF 2.0 Specification", section 3.9 (materials).
"""

from dataclasses import dataclass
from enum import StrEnum


class AlphaMode(StrEnum):
    """What the alpha of a base colour does."""

    OPAQUE = "OPAQUE"
    """Nothing."""
    MASK = "MASK"
    """Cuts away what lies under the cutoff."""
    BLEND = "BLEND"
    """Lets that share of what is behind through."""


@dataclass(frozen=True, slots=True)
class MaterialMap:
    """A further image of a material."""

    texture: int
    """Index into the paint's textures."""
    uv_set: int = 0
    """Which texture coordinates: 0 those of the base colour, else one more than the index into `more_uv`."""
    strength: float = 1.0
    """Scale of a normal map, strength of an occlusion map; 1 for others [-]."""


@dataclass(frozen=True, slots=True)
class SurfaceMaterial:
    """A material as its file has it; its base colour is the paint's."""

    name: str = ""
    alpha_mode: AlphaMode = AlphaMode.OPAQUE
    alpha_cutoff: float = 0.5
    """Least alpha that is seen with `MASK` [-]."""
    alpha: float = 1.0
    """Factor of the texture's alpha, 0..1 [-]."""
    metallic: float | None = None
    """Factor 0..1 [-]; None: the file does not say."""
    roughness: float | None = None
    """Factor 0..1 [-]; None: the file does not say."""
    emission: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Linear factor 0..1 of the light that it sends out by itself."""
    double_sided: bool | None = None
    """Whether backs are seen; None: the file does not say."""
    metallic_roughness_map: MaterialMap | None = None
    """Roughness in green, metalness in blue, both linear."""
    normal_map: MaterialMap | None = None
    """Tangent-space normals, linear."""
    occlusion_map: MaterialMap | None = None
    """Ambient occlusion in red, linear."""
    emissive_map: MaterialMap | None = None
    """Light that it sends out by itself, sRGB."""

    @property
    def maps(self) -> tuple[MaterialMap, ...]:
        """The further images that it has."""
        each = (self.metallic_roughness_map, self.normal_map, self.occlusion_map, self.emissive_map)
        return tuple(one for one in each if one is not None)


PLAIN = SurfaceMaterial()
"""Of a face that has a colour and nothing else."""
