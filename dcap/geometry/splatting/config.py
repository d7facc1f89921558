"""Settings of the reconstruction of surfaces from splats; apart, because reading them must not load Taichi."""

from typing import Annotated

from pydantic import BaseModel, Field, PositiveFloat, PositiveInt


class SurfaceConfig(BaseModel, frozen=True, extra="forbid"):
    """How finely a surface is looked for."""

    places: PositiveInt = 18
    """Places that pictures are taken from: six each inside a room."""
    pixels: PositiveInt = 480
    """Side of each picture [pixel]."""
    seen: PositiveFloat = 0.02
    """A Gaussian is part of the visible surface if somewhere it has this share of a pixel [-]"""
    slack: PositiveFloat = 0.5
    """and lies no farther than this behind the Gaussian in front, over the distance of Gaussians [-]."""
    level: PositiveFloat = 0.3
    """Density at the surface [-], SuGaR's default."""
    neighbours: PositiveInt = 24
    """Gaussians that make up the density at a place."""
    reach: PositiveFloat = 3.0
    """Samples lie this many standard deviations of the nearest Gaussian around it [-]."""
    samples: PositiveInt = 21
    """Samples along a ray."""
    blur: Annotated[float, Field(ge=0)] = 0.25
    """Deviation that smooths the density whose ridge is the surface, over the distance of Gaussians [-]."""
    rounds: Annotated[int, Field(ge=0)] = 10
    """Steps from the level set to the ridge."""
    spacing: PositiveFloat = 0.006
    """Points nearer to each other than this with like normals are one [m]."""
    cell: PositiveFloat = 0.01
    """Cell of the reconstruction, if `deepest` allows [m]."""
    deepest: Annotated[int, Field(gt=0, le=11)] = 9
    """Depth of the reconstruction's octree: the scene's extent over two to this power is the least cell."""
    trim: PositiveFloat = 3.0
    """Reconstructed surface farther than this many cells from every point is invented and goes [-]."""
    faces: PositiveInt = 400_000
    """The mesh is decimated to this many."""
