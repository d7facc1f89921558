"""Products with the elastic tangent on its 27-point stencil and with its two-level preconditioner."""

import taichi as ti

from solver.kernels.elastic import cofactor, mat3, vec3, vec4f

SHARE = 16  # Taichi gives a thread no fewer than 512 iterations: a loop of SHARE per row spreads few rows over threads


@ti.kernel
def multiply(
    neighbour: ti.types.ndarray(),
    A: ti.types.ndarray(dtype=vec4f, ndim=3),
    scale: ti.f64,
    shift: ti.types.ndarray(),
    p: ti.types.ndarray(dtype=vec3, ndim=1),
    q: ti.types.ndarray(dtype=vec3, ndim=1),
):
    """q = (scale A + diag(shift)) p with A (n, 27, 3 columns, 4) on the 27 nodes around each; absent neighbours are -1.

    Columns of four let the compiler use packed arithmetic. Single precision is enough for a tangent.
    """
    for n in range(neighbour.shape[0]):
        total = vec4f(0.0)
        for s in range(27):
            m = neighbour[n, s]
            if m >= 0:
                u = ti.cast(p[m], ti.f32)
                total += A[n, s, 0] * u[0] + A[n, s, 1] * u[1] + A[n, s, 2] * u[2]
        q[n] = scale * vec3(total[0], total[1], total[2]) + shift[n] * p[n]


@ti.kernel
def invert_diagonal(
    A: ti.types.ndarray(dtype=vec4f, ndim=3),
    scale: ti.f64,
    shift: ti.types.ndarray(),
    more: ti.types.ndarray(),
    free: ti.types.ndarray(),
    inverse: ti.types.ndarray(dtype=mat3, ndim=1),
):
    """Inverses (n, 3, 3) of the 3 x 3 blocks scale A_nn + shift I + more_n; zero where a node is not free."""
    for n in range(shift.shape[0]):
        inverse[n] = mat3(0.0)
        if free[n] != 0:
            B = mat3(0.0)
            for i in ti.static(range(3)):
                for j in ti.static(range(3)):
                    B[i, j] = scale * A[n, 13, j][i] + more[n, 3 * i + j]
                B[i, i] += shift[n]
            C = cofactor(B)
            J = B[0, 0] * C[0, 0] + B[1, 0] * C[1, 0] + B[2, 0] * C[2, 0]
            inverse[n] = C.transpose() / J


@ti.kernel
def restrict(
    start: ti.types.ndarray(),
    node: ti.types.ndarray(),
    weight: ti.types.ndarray(),
    r: ti.types.ndarray(dtype=vec3, ndim=1),
    out: ti.types.ndarray(dtype=vec3, ndim=1),
):
    """out = P^T r per lattice node: the entries start[i] .. start[i + 1] are its nodes and their weights."""
    for task in range(out.shape[0] * SHARE):
        if task % SHARE != 0:
            continue
        i = task // SHARE
        total = vec3(0.0)
        for k in range(start[i], start[i + 1]):
            total += weight[k] * r[node[k]]
        out[i] = total


@ti.kernel
def precondition(
    inverse: ti.types.ndarray(dtype=mat3, ndim=1),
    r: ti.types.ndarray(dtype=vec3, ndim=1),
    corner: ti.types.ndarray(),
    weight: ti.types.ndarray(),
    y: ti.types.ndarray(dtype=vec3, ndim=1),
    z: ti.types.ndarray(dtype=vec3, ndim=1),
):
    """z = D^-1 r + P y with the (n, 8) lattice nodes around each node and their weights."""
    for n in range(r.shape[0]):
        total = inverse[n] @ r[n]
        for k in range(8):
            total += weight[n, k] * y[corner[n, k]]
        z[n] = total


@ti.kernel
def largest_change(
    start: ti.i32,
    stop: ti.i32,
    turn: ti.types.ndarray(),
    before: ti.types.ndarray(),
    now: ti.types.ndarray(),
) -> ti.f64:
    """Largest entry of |F_now - Q F_before| over the particles start <= p < stop; F (n, 9) row-major, Q (3, 3)."""
    largest = 0.0
    for p in range(start, stop):
        for i in ti.static(range(3)):
            for j in ti.static(range(3)):
                expected = turn[i, 0] * before[p, j] + turn[i, 1] * before[p, 3 + j] + turn[i, 2] * before[p, 6 + j]
                ti.atomic_max(largest, ti.abs(now[p, 3 * i + j] - expected))
    return largest
