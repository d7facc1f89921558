"""Layered material: transversely isotropic about the normal of its layers.

Five constants: across the layers E_t and nu_tp (lateral strain of the layers under pressure across them), in the layers
E_p and nu_p, and G_t, the shear modulus between them; nu_pt = nu_tp E_p / E_t follows from symmetry [B09, Sec. 3.2.14].

The energy is the sum of the energy of the largest isotropic material contained in it, fixed-corotated, and a part added
by the layers:

    psi = mu |F - R|^2 + lambda / 2 (J - 1)^2 + 1/2 [a w] K [a w]^T + 1/2 k_d |d|^2 + 1/2 k_s |s|^2

with a the stretch of the layers' area (sum of their two principal stretches, minus 2), w the stretch of the distance
between them, d the distortion within them (difference of the principal stretches) and s the slip of layers over each
other. All four follow the current orientation of the layers (kernels/layers.py), so layers that slip far keep their
length. mu, lambda are such that K, k_d and k_s have no negative part: the energy is never negative, and zero only for
rotations. At small strain it is the law of transverse isotropy; with isotropic constants K, k_d and k_s vanish and the
isotropic energy remains.

[B09] Bower: Applied Mechanics of Solids. CRC Press 2009.
"""

from dataclasses import dataclass

import numpy as np

from solver.arrays import Array
from solver.errors import ModelError

ISOTROPIC = 1e-9  # relative difference below which constants are isotropic: rounding of the input
UNIT = 1e-6  # tolerance of a normal's length


@dataclass(frozen=True, eq=False, slots=True)
class Layers:
    """The remaining constants of material points whose E and nu are those across layers; isotropic points repeat E and
    nu."""

    youngs_modulus: Array
    """Young's moduli E_p in the layers [Pa], shape (p,)."""
    poisson_ratio: Array
    """Poisson ratios nu_p in the layers [-], shape (p,)."""
    shear_modulus: Array
    """Shear moduli G_t between the layers [Pa], shape (p,)."""
    normal: Array
    """Unit normals of the layers in the start pose, of either sign, shape (p, 3)."""

    def check(self, name: str, across: Array, poisson: Array) -> None:
        """Raise ModelError for body `name` unless every point's energy is positive; E_t and nu_tp (p,)."""
        if not np.isfinite(self.normal).all() or (np.abs(np.linalg.norm(self.normal, axis=1) - 1.0) > UNIT).any():
            raise ModelError(f"body {name!r}: normals of layers must have length 1")
        along, in_plane, shear = self.youngs_modulus, self.poisson_ratio, self.shear_modulus
        within = (np.minimum(along, shear) > 0.0) & (np.abs(in_plane) < 1.0)
        bad = np.flatnonzero(~(within & (2.0 * along * poisson**2 < (1.0 - in_plane) * across)))
        if len(bad):
            p = bad[0]
            raise ModelError(
                f"body {name!r}: stiffness of layers is not positive definite with E_t {across[p]:g} Pa, nu_tp "
                f"{poisson[p]:g}, E_p {along[p]:g} Pa, nu_p {in_plane[p]:g}, G_t {shear[p]:g} Pa"
            )


def split(across: Array, poisson: Array, layers: Layers) -> tuple[Array, Array, Array]:
    """mu, lambda [Pa] (p,) of the isotropic part, and K_aa, K_aw, K_ww, k_d, k_s [Pa] of the layers, shape (p, 5).

    In terms of a and w the stiffness consists of C_11 + C_12, C_13 and C_33; for an isotropic material it is mu [1, 0;
    0, 2] + lambda [1, 1; 1, 1]. mu is the smallest shear modulus, or half of the smallest amount that K can spare,
    which keeps K definite; lambda is C_13 if K can spare it.
    """
    along, in_plane, shear = layers.youngs_modulus, layers.poisson_ratio, layers.shear_modulus
    s_aa, s_aw, s_ww = 2.0 * (1.0 - in_plane) / along, -2.0 * poisson / across, 1.0 / across
    determinant = s_aa * s_ww - s_aw**2
    k_aa, k_aw, k_ww = s_ww / determinant, -s_aw / determinant, s_aa / determinant
    twist = along / (2.0 * (1.0 + in_plane))
    own = across / (2.0 * (1.0 + poisson))
    same = (
        np.maximum.reduce([np.abs(along / across - 1.0), np.abs(in_plane - poisson), np.abs(shear / own - 1.0)])
        < ISOTROPIC
    )
    middle, half = 0.5 * (k_aa + 0.5 * k_ww), 0.5 * (k_aa - 0.5 * k_ww)
    spare = middle - np.sqrt(half**2 + 0.5 * k_aw**2)  # smallest eigenvalue of K over [1, 0; 0, 2]
    mu = np.minimum(np.minimum(twist, shear), 0.5 * spare)
    b_aa, b_ww = k_aa - mu, k_ww - 2.0 * mu
    most = (b_aa * b_ww - k_aw**2) / (b_aa + b_ww - 2.0 * k_aw)
    lam = np.clip(k_aw, 0.0, most)
    rest = np.stack([b_aa - lam, k_aw - lam, b_ww - lam, twist - mu, shear - mu], axis=-1)
    own_ratio = np.where(same, poisson, 0.0)
    own_lam = across * own_ratio / ((1.0 + own_ratio) * (1.0 - 2.0 * own_ratio))
    return np.where(same, own, mu), np.where(same, own_lam, lam), np.where(same[:, None], 0.0, rest)


def shear_modulus_across(mu: Array, lam: Array, added: Array) -> Array:
    """E_t / (2 (1 + nu_tp)) [Pa] of `split` constants (p,), (p,), (p, 5): mu of an isotropic material, and for layers
    the mu of an isotropic material with the same stiffness across, shape (p,)."""
    k_aa, k_aw, k_ww = added[:, 0] + mu + lam, added[:, 1] + lam, added[:, 2] + 2.0 * mu + lam
    across, poisson = k_ww - k_aw**2 / k_aa, 0.5 * k_aw / k_aa
    return across / (2.0 * (1.0 + poisson))


def frames(normal: Array) -> Array:
    """Rotations (p, 3, 3) whose columns are two directions in the layers and their unit normal (p, 3)."""
    least = np.eye(3)[np.argmin(np.abs(normal), axis=1)]
    first = np.cross(least, normal)
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    return np.stack([first, np.cross(normal, first), normal], axis=-1)


def stiffness(mu: Array, lam: Array, added: Array, frame: Array) -> Array:
    """Elasticity tensors C_ijkl [Pa], shape (p, 3, 3, 3, 3), of mu, lambda (p,), `added` (p, 5) and frames
    (p, 3, 3)."""
    one = np.eye(3)
    area, wide = np.diag([1.0, 1.0, 0.0]), np.diag([0.0, 0.0, 1.0])
    local = np.zeros((len(mu), 3, 3, 3, 3))

    def add(weight: Array, left: Array, right: Array) -> None:
        local[:] += weight[:, None, None, None, None] * np.einsum("ij,kl->ijkl", left, right)

    add(lam, one, one)
    add(added[:, 0], area, area)
    add(added[:, 1], area, wide)
    add(added[:, 1], wide, area)
    add(added[:, 2], wide, wide)
    shears = [np.zeros((3, 3)) for _ in range(3)]
    for pair, (i, j) in zip(shears, ((0, 1), (0, 2), (1, 2)), strict=True):
        pair[i, j] = pair[j, i] = 1.0
    for tensor in (np.diag([1.0, -1.0, 0.0]), shears[0]):  # the distortion d is (e_11 - e_22, 2 e_12)
        add(added[:, 3], tensor, tensor)
    for tensor in shears[1:]:  # the slip s is (2 e_13, 2 e_23)
        add(added[:, 4], tensor, tensor)
    local += mu[:, None, None, None, None] * (np.einsum("ik,jl->ijkl", one, one) + np.einsum("il,jk->ijkl", one, one))
    return np.asarray(np.einsum("pijkl,pai,pbj,pck,pdl->pabcd", local, frame, frame, frame, frame, optimize=True))
