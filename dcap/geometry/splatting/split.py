"""A Gaussian as many smaller ones that look alike: what one flat disc cannot follow, its pieces can.

Pieces lie on a grid in the plane of the larger two axes. Opacities do not add up, optical depths do: one Gaussian of
opacity a has -ln(1 - a exp(-r^2 / 2)), and pieces of opacity b and deviations s on a grid of steps h have on average
2 pi (s / h)^2 Li2(b), Li2 being the dilogarithm (the integral of -ln(1 - b exp(-r^2 / 2)) over the plane is
2 pi Li2(b)). So b follows from the optical depth that is wanted at a piece's place. What the pieces' own width adds to
the whole is taken off beforehand.
"""

from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from scipy.special import spence

from dcap.scene.types.gaussians import Gaussians

Array = NDArray[np.float64]

REACH = 2.7
"""Pieces lie up to this many deviations from the middle [-]; farther out there is less than 3 % of the opacity."""
OVERLAP = 0.8
"""Deviation of a piece over the grid's step [-]: with less, the sum is uneven."""
STEPS = (5, 7, 10, 14, 20, 28)
"""Steps of the grid to either side that there may be [-]; with the least, pieces are 0.43 times as wide."""
FAINT, SOLID = 1.0 / 255.0, 0.99
"""Least and most opacity that a renderer takes from one Gaussian [-]."""

_OPACITY = np.concatenate([[0.0], np.geomspace(1e-6, 0.5, 2000), 1.0 - np.geomspace(0.499, 1e-4, 2000)])
_DILOGARITHM = spence(1.0 - _OPACITY)


@dataclass(frozen=True, eq=False, slots=True)
class SplatPieces:
    """Pieces that Gaussians were split into."""

    splats: Gaussians
    """k pieces in the given frame, those of each Gaussian together and in its order."""
    owner: NDArray[np.int64]
    """Number of the Gaussian that each is a piece of, increasing, shape (k,)."""
    middle: NDArray[np.bool_]
    """One for each Gaussian: the piece at its centre, shape (k,)."""


def split(splats: Gaussians, steps: NDArray[np.int64]) -> SplatPieces:
    """Pieces of n Gaussians; `steps` (n, 2) to either side along the largest and the second axis are of STEPS."""
    owners, places, widths, opacities = (
        [np.zeros(0, dtype=np.int64)], [np.zeros((0, 2))], [np.zeros((0, 2))], [np.zeros(0)],
    )  # fmt: skip
    alpha = np.minimum(splats.opacity.astype(np.float64), SOLID)
    for pair in np.unique(steps, axis=0):
        index = np.flatnonzero((steps == pair).all(axis=1))
        place, width, opacity = pieces(alpha[index], pair)
        row, column = np.nonzero((opacity > FAINT) | (place == 0.0).all(axis=1))
        owners.append(index[row])
        places.append(place[column])
        widths.append(np.tile(width, (len(row), 1)))
        opacities.append(np.clip(opacity[row, column], 1e-4, SOLID))
    order = np.argsort(np.concatenate(owners), kind="stable")
    owner, opacity = np.concatenate(owners)[order], np.concatenate(opacities)[order]
    place, width = np.concatenate(places)[order], np.concatenate(widths)[order]
    wide = np.argsort(-splats.log_scale, axis=1, kind="stable")[owner, :2]
    rows = np.arange(len(owner))[:, None]
    part = splats.subset(owner)
    across = np.swapaxes(part.axes, 1, 2)[rows, wide] * part.scale[rows, wide][:, :, None]
    log_scale = part.log_scale.copy()
    log_scale[rows, wide] += np.log(width).astype(np.float32)
    found = replace(
        part,
        position=(part.position + np.einsum("nk,nki->ni", place, across)).astype(np.float32),
        log_scale=log_scale,
        logit=np.log(opacity / (1.0 - opacity)).astype(np.float32),
    )
    return SplatPieces(found, owner, (place == 0.0).all(axis=1))


def pieces(alpha: Array, steps: NDArray[np.int64]) -> tuple[Array, Array, Array]:
    """Places (k, 2) and widths (2,) of pieces in deviations of the whole, and opacities (n, k) for its own (n,)."""
    one, two = (REACH * np.arange(-count, count + 1) / count for count in steps)
    place = np.stack(np.meshgrid(one, two, indexing="ij"), axis=-1).reshape(-1, 2)
    width = OVERLAP * REACH / steps
    rest = 1.0 - width**2  # of the variance, that the pieces' places have to make
    fall = np.exp(-0.5 * (place**2 / rest).sum(axis=1))
    depth = -np.log1p(-alpha[:, None] * fall) / np.sqrt(rest.prod())
    return place, width, np.interp(depth / (2.0 * np.pi * OVERLAP**2), _DILOGARITHM, _OPACITY)
