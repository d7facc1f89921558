"""Products with the elastic tangent on its 27-point stencil and with its two-level preconditioner."""

import taichi as ti

from solver.kernels.elastic import cofactor, mat3, mat3f, vec3, vec4f

vec3f = ti.types.vector(3, ti.f32)
vec4h = ti.types.vector(4, ti.f16)

BLOCK = 2048  # approximate nodes of a Gauss-Seidel block: smaller ones cost iterations, larger ones leave threads idle
LEAST = 512  # Taichi gives a thread at least this many iterations: a block counts as this many
SHARE = 16  # for the same reason a lattice row counts as this many: spreads few rows over threads


@ti.kernel
def multiply(
    neighbour: ti.types.ndarray(),
    A: ti.types.ndarray(dtype=vec4f, ndim=3),
    scale: ti.f64,
    shift: ti.types.ndarray(),
    p: ti.types.ndarray(dtype=vec3, ndim=1),
    q: ti.types.ndarray(dtype=vec3, ndim=1),
):
    """q = (scale A + diag(shift)) p with A (n, 27, 3 columns, 4) on the 27 nodes around each node; absent neighbours
    are -1.

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
    inverse: ti.types.ndarray(dtype=mat3f, ndim=1),
):
    """Inverses (n, 3, 3) of the 3 x 3 blocks scale A_nn + shift I + more_n; zero where a node is not free."""
    for n in range(shift.shape[0]):
        inverse[n] = mat3f(0.0)
        if free[n] != 0:
            B = mat3(0.0)
            for i in ti.static(range(3)):
                for j in ti.static(range(3)):
                    B[i, j] = scale * A[n, 13, j][i] + more[n, 3 * i + j]
                B[i, i] += shift[n]
            C = cofactor(B)
            J = B[0, 0] * C[0, 0] + B[1, 0] * C[1, 0] + B[2, 0] * C[2, 0]
            inverse[n] = ti.cast(C.transpose() / J, ti.f32)


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
def add_contacts(
    column_start: ti.types.ndarray(),
    column_point: ti.types.ndarray(),
    column_weight: ti.types.ndarray(),
    row_start: ti.types.ndarray(),
    row_node: ti.types.ndarray(),
    row_weight: ti.types.ndarray(),
    T: ti.types.ndarray(dtype=mat3, ndim=1),
    A: ti.types.ndarray(),
):
    """Adds to the lower triangle of the dense A the blocks sum_k G_ki T_k G_kj of lattice nodes i and j; G is given by
    its columns, one per node, and by its rows, one per contact point."""
    for task in range((column_start.shape[0] - 1) * SHARE):
        if task % SHARE != 0:
            continue
        i = task // SHARE
        for e in range(column_start[i], column_start[i + 1]):
            k = column_point[e]
            block = column_weight[e] * T[k]
            for g in range(row_start[k], row_start[k + 1]):
                j = row_node[g]
                if j <= i:
                    for a in ti.static(range(3)):
                        for b in ti.static(range(3)):
                            A[3 * i + a, 3 * j + b] = A[3 * i + a, 3 * j + b] + row_weight[g] * block[a, b]


@ti.kernel
def halve(
    late: ti.types.ndarray(),
    A: ti.types.ndarray(dtype=vec4f, ndim=3),
    unit: ti.types.ndarray(),
    half: ti.types.ndarray(dtype=vec4h, ndim=3),
):
    """half = A / unit in half precision, in the rows n where late[n] is not zero."""
    for n in range(unit.shape[0]):
        if late[n] != 0:
            for s in range(27):
                for j in ti.static(range(3)):
                    half[n, s, j] = ti.cast(A[n, s, j] / unit[n], ti.f16)


@ti.func
def column(A: ti.template(), n: ti.i32, s: ti.i32, j: ti.i32):
    return ti.cast(A[n, s, j], ti.f32)


@ti.kernel
def precondition(
    neighbour: ti.types.ndarray(),
    A: ti.types.ndarray(dtype=vec4h, ndim=3),
    unit: ti.types.ndarray(),
    scale: ti.f32,
    inverse: ti.types.ndarray(dtype=mat3f, ndim=1),
    r: ti.types.ndarray(dtype=vec3, ndim=1),
    corner: ti.types.ndarray(),
    weight: ti.types.ndarray(),
    y: ti.types.ndarray(dtype=vec3, ndim=1),
    u: ti.types.ndarray(dtype=vec3f, ndim=1),
    z: ti.types.ndarray(dtype=vec3, ndim=1),
):
    """z = (D + U)^-1 D (D + L)^-1 r + P y: a symmetric Gauss-Seidel sweep with scale unit A = L + D + U and given D^-1,
    and the (n, 8) lattice nodes around each node with their weights; u is a buffer for the sweep.

    A preconditioner need not be exact: half precision takes less time to read. A sweep only couples the nodes of one
    block: blocks go to threads, and their number does not affect the result. A neighbour in slot s < 13 has a smaller
    index than its node, in slot s > 13 a larger one.
    """
    nodes = r.shape[0]
    blocks = 2 * ti.max(1, (nodes + BLOCK) // (2 * BLOCK))
    size = (nodes + blocks - 1) // blocks
    for task in range(blocks * LEAST):
        if task % LEAST != 0:
            continue
        first = task // LEAST * size
        last = ti.min(first + size, nodes)
        for n in range(first, last):
            total = vec4f(0.0)
            for s in range(13):
                m = neighbour[n, s]
                if m >= first:
                    v = u[m]
                    total += column(A, n, s, 0) * v[0] + column(A, n, s, 1) * v[1] + column(A, n, s, 2) * v[2]
            u[n] = inverse[n] @ (ti.cast(r[n], ti.f32) - scale * unit[n] * vec3f(total[0], total[1], total[2]))
        for k in range(last - first):
            n = last - 1 - k
            total = vec4f(0.0)
            for s in range(14, 27):
                m = neighbour[n, s]
                if m >= 0 and m < last:
                    v = u[m]
                    total += column(A, n, s, 0) * v[0] + column(A, n, s, 1) * v[1] + column(A, n, s, 2) * v[2]
            u[n] = u[n] - scale * unit[n] * (inverse[n] @ vec3f(total[0], total[1], total[2]))
    for n in range(nodes):
        total = ti.cast(u[n], ti.f64)
        for k in range(8):
            total += weight[n, k] * y[corner[n, k]]
        z[n] = total


@ti.kernel
def changes(
    cell_start: ti.types.ndarray(),
    turn: ti.types.ndarray(),
    before: ti.types.ndarray(),
    now: ti.types.ndarray(),
    change: ti.types.ndarray(),
):
    """Largest entry of |F_now - Q F_before| over the particles of each cell; F (n, 9) row-major, Q (3, 3)."""
    for c in range(change.shape[0]):
        largest = 0.0
        for p in range(cell_start[c], cell_start[c + 1]):
            for i in ti.static(range(3)):
                for j in ti.static(range(3)):
                    f = turn[i, 0] * before[p, j] + turn[i, 1] * before[p, 3 + j] + turn[i, 2] * before[p, 6 + j]
                    largest = ti.max(largest, ti.abs(now[p, 3 * i + j] - f))
        change[c] = largest
