"""Moments of blocks of particles, from which their rigid motion follows, and changes of that motion.

[J15] Jiang, Schroeder, Selle, Teran, Stomakhin: The affine particle-in-cell method. SIGGRAPH 2015.
"""

import taichi as ti

from solver.kernels.elastic import load3, mat3, vec3

SHARE = 16  # Taichi gives a thread no fewer iterations than 1024: each block stands for so many of them

# columns of the sums of one block of particles; vectors and m x x^T start at theirs
MASS = 0  # m
FIRST_MOMENT = 1  # m x, 3 columns
MOMENTUM = 4  # m v, 3 columns
ANGULAR_MOMENTUM = 7  # about the origin, 3 columns
SECOND_MOMENT = 10  # m x x^T: xx, yy, zz, yz, zx, xy
ENERGY = 16  # kinetic
MOMENTS = 17  # so many columns are sums over particles; then
SQUARED_SPEED = 17  # of the fastest particle
STRAYS = 18  # particles that have left their pencil
INVERSIONS = 19  # particles with det F <= 0
SUMS = 20  # columns in all


@ti.func
def moments(h: ti.f64, X: vec3, V: vec3, B: mat3, m: ti.f64):
    """What one particle adds to the first MOMENTS sums of its block; its affine part counts in angular
    momentum and energy [J15]."""
    D = 0.25 * h * h
    L = m * (X.cross(V) + D * vec3(B[2, 1] - B[1, 2], B[0, 2] - B[2, 0], B[1, 0] - B[0, 1]))
    out = ti.Vector.zero(ti.f64, MOMENTS)
    out[MASS] = m
    for d in ti.static(range(3)):
        out[FIRST_MOMENT + d] = m * X[d]
        out[MOMENTUM + d] = m * V[d]
        out[ANGULAR_MOMENTUM + d] = L[d]
        out[SECOND_MOMENT + d] = m * X[d] * X[d]
        out[SECOND_MOMENT + 3 + d] = m * X[(d + 1) % 3] * X[(d + 2) % 3]
    out[ENERGY] = 0.5 * m * (V.norm_sqr() + D * B.norm_sqr())
    return out


@ti.kernel
def move_group(
    group: ti.i32,
    h: ti.f64,
    keep: ti.f64,
    motion: ti.types.ndarray(dtype=ti.f64, ndim=2),
    block: ti.types.ndarray(dtype=ti.i32, ndim=2),
    block_group: ti.types.ndarray(dtype=ti.i32, ndim=1),
    x: ti.types.ndarray(dtype=ti.f64, ndim=2),
    v: ti.types.ndarray(dtype=ti.f64, ndim=2),
    C: ti.types.ndarray(dtype=ti.f64, ndim=2),
    constant: ti.types.ndarray(dtype=ti.f64, ndim=2),
    sums: ti.types.ndarray(dtype=ti.f64, ndim=2),
):
    """v <- keep (v - rigid motion) + new rigid motion for the particles of one group.

    motion = (centre, V, w, new V, new w), five rows; renews the moments in the sums of the group's blocks.
    """
    for task in range(block.shape[0] * SHARE):
        if task % SHARE != 0:
            continue
        b = task // SHARE
        if block_group[b] == group:
            c = vec3(motion[0, 0], motion[0, 1], motion[0, 2])
            V0 = vec3(motion[1, 0], motion[1, 1], motion[1, 2])
            w0 = vec3(motion[2, 0], motion[2, 1], motion[2, 2])
            V1 = vec3(motion[3, 0], motion[3, 1], motion[3, 2])
            w1 = vec3(motion[4, 0], motion[4, 1], motion[4, 2])
            total = ti.Vector.zero(ti.f64, MOMENTS)
            fastest = 0.0
            wd = w1 - keep * w0
            spin = mat3([[0.0, -wd[2], wd[1]], [wd[2], 0.0, -wd[0]], [-wd[1], wd[0], 0.0]])
            for p in range(block[b, 0], block[b, 1]):
                X = vec3(x[p, 0], x[p, 1], x[p, 2])
                arm = X - c
                V = keep * vec3(v[p, 0], v[p, 1], v[p, 2]) + (V1 - keep * V0) + wd.cross(arm)
                B = keep * load3(C, p) + spin
                for d in ti.static(range(3)):
                    v[p, d] = V[d]
                    for e in ti.static(range(3)):
                        C[p, 3 * d + e] = B[d, e]
                total += moments(h, X, V, B, constant[p, 0])
                fastest = ti.max(fastest, V.norm_sqr())
            for s in ti.static(range(MOMENTS)):
                sums[b, s] = total[s]
            sums[b, SQUARED_SPEED] = fastest
