"""3D Gaussian splats: the elements of a scan by Gaussian splatting [K23].

Fields are kept as the formats store them (logarithms, logits, harmonics), so that reading and writing lose nothing;
properties give the physical values.

[K23] Kerbl, Kopanas, Leimkuehler, Drettakis: 3D Gaussian splatting for real-time radiance field rendering. ACM Trans.
Graph. 42(4), 2023.
"""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from dcap.arrays import Float32Array
from dcap.scene.errors import GeometryError
from dcap.scene.types.arrays import check_array

DC = 0.28209479177387814
"""The constant spherical harmonic, 1 / (2 sqrt(pi)) [-]."""

COEFFICIENTS = {0: 0, 1: 3, 2: 8, 3: 15}
"""Number of harmonics above the constant one, per colour channel, by degree."""

SAMPLED = 32
"""Number of directions in which harmonics are evaluated to rotate them; the largest band has 7 unknowns [-]."""


@dataclass(frozen=True, eq=False, slots=True)
class Gaussians:
    """n anisotropic Gaussians with opacity and view-dependent colour, single precision."""

    position: Float32Array
    """Centres [m], shape (n, 3)."""
    log_scale: Float32Array
    """Natural logarithms of the standard deviations [m] along the Gaussian's axes, shape (n, 3)."""
    rotation: Float32Array
    """Quaternions (w, x, y, z) of any length, world from the Gaussian's axes, shape (n, 4)."""
    logit: Float32Array
    """Opacity alpha as ln(alpha / (1 - alpha)), shape (n,)."""
    dc: Float32Array
    """Constant harmonic per channel: linear in sRGB colour, (colour - 1/2) / DC, shape (n, 3)."""
    rest: Float32Array
    """Higher harmonics, channel by channel, shape (n, 3, k) with k of COEFFICIENTS."""

    def __post_init__(self) -> None:
        n = len(self.position)
        check_array("positions of Gaussians", self.position, None, 3)
        for name, array, *shape in (
            ("log scales", self.log_scale, 3), ("rotations", self.rotation, 4), ("logits", self.logit),
            ("constant harmonics", self.dc, 3), ("harmonics", self.rest, 3, None),
        ):  # fmt: skip
            check_array(f"{name} of Gaussians", array, n, *shape)
        if self.rest.shape[2] not in COEFFICIENTS.values():
            raise GeometryError(f"Gaussians have {self.rest.shape[2]} harmonics per channel, expected 0, 3, 8 or 15")

    def __len__(self) -> int:
        return len(self.position)

    @property
    def degree(self) -> int:
        """Highest degree of the harmonics."""
        return next(degree for degree, count in COEFFICIENTS.items() if count == self.rest.shape[2])

    @property
    def scale(self) -> Float32Array:
        """Standard deviations [m], shape (n, 3)."""
        return np.asarray(np.exp(self.log_scale), dtype=np.float32)

    @property
    def opacity(self) -> Float32Array:
        """Alpha [-], shape (n,)."""
        return np.asarray(1.0 / (1.0 + np.exp(-self.logit)), dtype=np.float32)

    @property
    def color(self) -> NDArray[np.uint8]:
        """sRGB colour without view dependence, shape (n, 3)."""
        return np.asarray(np.clip(np.rint(255.0 * (DC * self.dc + 0.5)), 0, 255), dtype=np.uint8)

    @property
    def axes(self) -> Float32Array:
        """Rotation matrices whose columns are the Gaussians' axes in the world, shape (n, 3, 3)."""
        return np.asarray(Rotation.from_quat(self.rotation, scalar_first=True).as_matrix(), dtype=np.float32)

    def subset(self, index: NDArray[np.integer] | NDArray[np.bool_]) -> Self:
        """A copy with only the given Gaussians."""
        return replace(
            self, position=self.position[index], log_scale=self.log_scale[index], rotation=self.rotation[index],
            logit=self.logit[index], dc=self.dc[index], rest=self.rest[index],
        )  # fmt: skip

    def transformed(self, world_from_file: NDArray[np.float64]) -> Self:
        """A copy moved, turned and scaled by a similarity (4, 4), including the harmonics. Raises GeometryError for
        another map."""
        linear, shift = world_from_file[:3, :3], world_from_file[:3, 3]
        factor = float(np.cbrt(np.linalg.det(linear)))
        turn = linear / factor if factor > 0.0 else linear
        if factor <= 0.0 or not np.allclose(turn @ turn.T, np.eye(3), atol=1e-6):
            raise GeometryError("Gaussians support only rotation, translation and uniform scaling")
        own = Rotation.from_quat(self.rotation, scalar_first=True)
        return replace(
            self,
            position=(self.position @ linear.T + shift).astype(np.float32),
            log_scale=(self.log_scale + np.log(factor)).astype(np.float32),
            rotation=(Rotation.from_matrix(turn) * own).as_quat(scalar_first=True).astype(np.float32),
            rest=turned_harmonics(self.rest, turn, self.degree),
        )


def joined_splats(parts: Sequence[Gaussians]) -> Gaussians:
    """All Gaussians of parts with the same degree, one part after the other."""
    names = [one.name for one in fields(Gaussians)]
    return Gaussians(*(np.concatenate([getattr(part, name) for part in parts]) for name in names))


def harmonics(directions: NDArray[np.float64], degree: int) -> NDArray[np.float64]:
    """Real spherical harmonics of degrees 1 to `degree` in the order and with the signs of [K23], shape (n, k).

    Directions (n, 3) are unit vectors.
    """
    x, y, z = directions.T
    one = np.sqrt(3.0 / (4.0 * np.pi))
    columns = [-one * y, one * z, -one * x]
    if degree > 1:
        two = np.sqrt(15.0 / (4.0 * np.pi))
        columns += [
            two * x * y, -two * y * z, np.sqrt(5.0 / (16.0 * np.pi)) * (2 * z * z - x * x - y * y), -two * x * z,
            0.5 * two * (x * x - y * y),
        ]  # fmt: skip
    if degree > 2:
        a, b, c, d = (np.sqrt(v / np.pi) for v in (35.0 / 32.0, 105.0 / 4.0, 21.0 / 32.0, 7.0 / 16.0))
        columns += [
            -a * y * (3 * x * x - y * y), b * x * y * z, -c * y * (4 * z * z - x * x - y * y),
            d * z * (2 * z * z - 3 * x * x - 3 * y * y), -c * x * (4 * z * z - x * x - y * y),
            0.5 * b * z * (x * x - y * y), -a * x * (x * x - 3 * y * y),
        ]  # fmt: skip
    return np.stack(columns[: COEFFICIENTS[degree]], axis=1)


def turned_harmonics(rest: Float32Array, turn: NDArray[np.float64], degree: int) -> Float32Array:
    """Coefficients (n, 3, k) of the same colours seen from rotated directions, for one rotation (3, 3) or one each (n,
    3, 3).

    A rotated function has harmonics of the same degree only; its coefficients follow by least squares from its values
    in more directions than there are unknowns. That is exact to rounding, and needs no recursion over degrees.
    """
    if degree == 0:
        return rest
    random = np.random.default_rng(0).standard_normal((SAMPLED, 3))
    directions = random / np.linalg.norm(random, axis=1, keepdims=True)
    after = harmonics(directions, degree)
    turned = (directions @ turn).reshape(-1, 3)
    before = harmonics(turned, degree).reshape(*turn.shape[:-2], SAMPLED, after.shape[1])
    out = np.empty_like(rest)
    first = 0
    for band in range(1, degree + 1):
        at = slice(first, first + 2 * band + 1)
        first = at.stop
        map_ = np.linalg.pinv(after[:, at]) @ before[..., at]
        out[:, :, at] = rest[:, :, at] @ np.swapaxes(map_, -1, -2)
    return out
