"""Settings of the reconstruction of surfaces from splats; a separate module, because reading them must not load
Taichi."""

from typing import Annotated

from pydantic import BaseModel, Field, PositiveFloat, PositiveInt


class SurfaceConfig(BaseModel, frozen=True, extra="forbid"):
    """Resolution of the search for a surface."""

    places: PositiveInt = 18
    """Places of the cameras; inside a room six pictures each."""
    pixels: PositiveInt = 480
    """Side of each picture [pixel]."""
    seen: PositiveFloat = 0.02
    """A Gaussian is visible if it covers this share of a pixel in some picture [-] ..."""
    slack: PositiveFloat = 0.5
    """... and lies at most this far behind the front one, over the distance of Gaussians [-]."""
    level: PositiveFloat = 0.3
    """Density at the surface [-], SuGaR's default."""
    neighbours: PositiveInt = 24
    """Gaussians that contribute to the density at a point."""
    reach: PositiveFloat = 3.0
    """Extent of the samples around the nearest Gaussian, in its standard deviations [-]."""
    samples: PositiveInt = 21
    """Samples along a ray."""
    blur: Annotated[float, Field(ge=0)] = 0.25
    """Standard deviation that smooths the density, over the distance of Gaussians [-]."""
    rounds: Annotated[int, Field(ge=0)] = 10
    """Iterations from the level set to the ridge of the density."""
    spacing: PositiveFloat = 0.006
    """Nearer points with like normals are merged [m]."""
    cell: PositiveFloat = 0.01
    """Cell of the reconstruction, if `deepest` allows [m]."""
    deepest: Annotated[int, Field(gt=0, le=11)] = 9
    """Depth of the reconstruction's octree."""
    trim: PositiveFloat = 3.0
    """Reconstructed surface farther than this many cells from every point is removed [-]."""
    faces: PositiveInt = 400_000
    """Faces after decimation."""
