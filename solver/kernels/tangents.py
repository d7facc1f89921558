"""Tangent of the elastic forces of elastic.py, with the same symbols: per cell, on the stencil of the nodes, and
coarse.

It is the tangent at rest, turned with the cell (warped stiffness [M04]), and the true tangent without its negative part
[S19] where strain is large.

[M04] Mueller, Gross: Interactive virtual materials. Graphics Interface 2004.
[S19] Smith, de Goes, Kim: Analytic eigensystems for isotropic distortion energies. ACM Trans. Graph. 38(1), 2019.
[G13] Golub, Van Loan: Matrix Computations, 4th ed. Johns Hopkins 2013.
"""

import taichi as ti

from solver.kernels.elastic import (
    SMALLEST_BULK,
    cofactor,
    load3,
    mat3,
    mat3f,
    shape_gradient,
    shape_gradients,
    side,
    vec3,
    vec4f,
)
from solver.model.bending import MODES

vec9 = ti.types.vector(9, ti.f64)
vec9f = ti.types.vector(9, ti.f32)

JACOBI_SWEEPS = 6  # converge quadratically: four reach rounding
JACOBI_SMALL = 1e-16  # of the diagonal: nothing left to rotate away
SMALLEST_STRETCH = 1e-3  # sum of two singular values [-] below which a particle is inverted


@ti.kernel
def rest_tangents(
    cell_size: ti.types.ndarray(),
    cell_start: ti.types.ndarray(),
    xi: ti.types.ndarray(),
    V: ti.types.ndarray(),
    mu: ti.types.ndarray(),
    lam: ti.types.ndarray(),
    relief: ti.types.ndarray(),
    B: ti.types.ndarray(dtype=vec3, ndim=2),
    K: ti.types.ndarray(dtype=mat3f, ndim=3),
):
    """Per cell the 8 x 8 blocks at rest, K_ab = sum V mu [(g_a . g_b) I + g_b g_a^T] + B_a B_b^T / sum V lambda with
    B_a = sum V lambda g_a, minus the second derivative of the relief."""
    for c in range(cell_size.shape[0]):
        h = vec3(cell_size[c, 0], cell_size[c, 1], cell_size[c, 2])
        bulk = SMALLEST_BULK
        for a in range(8):
            B[c, a] = vec3(0.0)
            for b in range(8):
                K[c, a, b] = mat3f(0.0)
        for p in range(cell_start[c], cell_start[c + 1]):
            s = vec3(xi[p, 0], xi[p, 1], xi[p, 2])
            m, la = V[p] * mu[p], V[p] * lam[p]
            bulk += la
            for a in range(8):
                ga = shape_gradient(a, s, h)
                B[c, a] = B[c, a] + la * ga
                for b in range(a + 1):
                    gb = shape_gradient(b, s, h)
                    block = m * gb.outer_product(ga)
                    dot = m * ga.dot(gb)
                    for i in ti.static(range(3)):
                        block[i, i] += dot
                    K[c, a, b] = K[c, a, b] + ti.cast(block, ti.f32)
        for a in range(8):
            for b in range(a + 1):
                block = B[c, a].outer_product(B[c, b]) / bulk
                for m in ti.static(range(6)):
                    i = ti.static(MODES[m][0])
                    j = ti.static(MODES[m][1])
                    k = ti.static(MODES[m ^ 1][0])
                    share = side(a, i) * side(a, j) * side(b, j) / 64.0
                    block[i, i] -= relief[c, m] * share * side(b, i)
                    block[i, k] -= relief[c, ti.static(6 + m // 2)] * share * side(b, k)
                K[c, a, b] = K[c, a, b] + ti.cast(block, ti.f32)
                if b < a:
                    K[c, b, a] = K[c, a, b].transpose()


@ti.kernel
def turn_tangents(
    late: ti.types.ndarray(),
    cell_start: ti.types.ndarray(),
    V: ti.types.ndarray(),
    R: ti.types.ndarray(),
    K_rest: ti.types.ndarray(dtype=mat3f, ndim=3),
    K: ti.types.ndarray(dtype=mat3f, ndim=3),
):
    """Warped stiffness of each cell c where late[c] is not zero: K_ab = R K_ab(rest) R^T with the volume average R of
    its particles' rotations [M04]."""
    for c in range(K.shape[0]):
        if late[c] != 0:
            Q = ti.Matrix.zero(ti.f64, 3, 3)
            total = 0.0
            for p in range(cell_start[c], cell_start[c + 1]):
                Q += V[p] * load3(R, p)
                total += V[p]
            Q /= total
            for a in range(8):
                for b in range(a + 1):
                    k = Q @ ti.cast(K_rest[c, a, b], ti.f64) @ Q.transpose()
                    K[c, a, b] = ti.cast(k, ti.f32)
                    K[c, b, a] = ti.cast(k.transpose(), ti.f32)


@ti.func
def eigen(A: mat3):
    """Eigenvalues and eigenvectors (columns) of a symmetric matrix by cyclic Jacobi rotations [G13, Sec. 8.5]; unlike
    closed forms they stay exact for equal eigenvalues, which occur under a round body."""
    D, X = A, ti.Matrix.identity(ti.f64, 3)
    for _ in range(JACOBI_SWEEPS):
        for k in ti.static(range(3)):
            i, j = ti.static((k + 1) % 3, (k + 2) % 3)
            if ti.abs(D[i, j]) > JACOBI_SMALL * (ti.abs(D[i, i]) + ti.abs(D[j, j])):
                tau = 0.5 * (D[j, j] - D[i, i]) / D[i, j]
                t = (1.0 if tau >= 0.0 else -1.0) / (ti.abs(tau) + ti.sqrt(1.0 + tau**2))
                c = 1.0 / ti.sqrt(1.0 + t**2)
                Q = ti.Matrix.identity(ti.f64, 3)
                Q[i, i], Q[i, j], Q[j, i], Q[j, j] = c, t * c, -t * c, c
                D = Q.transpose() @ D @ Q
                X = X @ Q
    return vec3(D[0, 0], D[1, 1], D[2, 2]), X


@ti.func
def clamped_scalings(mu: ti.f64, pressure: ti.f64, sigma: vec3) -> mat3:
    """2 mu I + pressure d^2 J / d sigma^2 in the singular values, without its negative eigenvalues."""
    A = mat3(0.0)
    for k in ti.static(range(3)):
        A[k, k] = 2.0 * mu
        i, j = ti.static((k + 1) % 3, (k + 2) % 3)
        A[i, j] = A[j, i] = pressure * sigma[k]
    values, vectors = eigen(A)
    out = mat3(0.0)
    for m in ti.static(range(3)):
        v = vec3(vectors[0, m], vectors[1, m], vectors[2, m])
        out += ti.max(values[m], 0.0) * v.outer_product(v)
    return out


@ti.kernel
def strained_tangents(
    limit: ti.f64,
    first: ti.i32,
    late: ti.types.ndarray(),
    cell_size: ti.types.ndarray(),
    cell_start: ti.types.ndarray(),
    xi: ti.types.ndarray(),
    V: ti.types.ndarray(),
    mu: ti.types.ndarray(),
    lam: ti.types.ndarray(),
    F_in: ti.types.ndarray(),
    R: ti.types.ndarray(),
    K: ti.types.ndarray(dtype=mat3f, ndim=3),
):
    """Replaces the tangents of cells first + k with late[k] not zero, in which a particle is strained by more than
    `limit`, by their own second derivative without its negative part: in the basis of singular vectors it is diagonal
    except for a 3 x 3 block [S19, Sec. 5]. The relief of bending is left out."""
    for at in range(late.shape[0]):
        if late[at] == 0:
            continue
        c = first + at
        h = vec3(cell_size[c, 0], cell_size[c, 1], cell_size[c, 2])
        strain, dilation, bulk = 0.0, 0.0, SMALLEST_BULK
        for p in range(cell_start[c], cell_start[c + 1]):
            F = load3(F_in, p)
            S = load3(R, p).transpose() @ F
            for i in ti.static(range(3)):
                for j in ti.static(range(3)):
                    strain = ti.max(strain, ti.abs(S[i, j] - (1.0 if ti.static(i == j) else 0.0)))
            dilation += V[p] * lam[p] * (F.determinant() - 1.0)
            bulk += V[p] * lam[p]
        if strain > limit:
            dilation /= bulk
            for a in range(8):
                for b in range(8):
                    K[c, a, b] = mat3f(0.0)
            B = ti.Matrix.zero(ti.f64, 8, 3)
            for p in range(cell_start[c], cell_start[c + 1]):
                s = vec3(xi[p, 0], xi[p, 1], xi[p, 2])
                F, Q = load3(F_in, p), load3(R, p)
                S = Q.transpose() @ F
                sigma, right = eigen(0.5 * (S + S.transpose()))
                left = Q @ right
                pressure = lam[p] * dilation
                scaling = V[p] * clamped_scalings(mu[p], pressure, sigma)
                twist, flip = vec3(0.0), vec3(0.0)
                for k in ti.static(range(3)):
                    around = sigma[ti.static((k + 1) % 3)] + sigma[ti.static((k + 2) % 3)]
                    turning = 2.0 * mu[p] * (1.0 - 2.0 / ti.max(around, SMALLEST_STRETCH)) + pressure * sigma[k]
                    twist[k] = 0.5 * V[p] * ti.max(turning, 0.0)
                    flip[k] = 0.5 * V[p] * ti.max(2.0 * mu[p] - pressure * sigma[k], 0.0)
                B += V[p] * lam[p] * shape_gradients(s, h) @ cofactor(F).transpose()
                for a in range(8):
                    u = right.transpose() @ shape_gradient(a, s, h)
                    for b in range(a + 1):
                        w = right.transpose() @ shape_gradient(b, s, h)
                        block = mat3(0.0)
                        for i in ti.static(range(3)):
                            for j in ti.static(range(3)):
                                block[i, j] += scaling[i, j] * u[i] * w[j]
                                if ti.static(i != j):
                                    k = ti.static(3 - i - j)
                                    block[i, i] += (flip[k] + twist[k]) * u[j] * w[j]
                                    block[i, j] += (flip[k] - twist[k]) * u[j] * w[i]
                        K[c, a, b] = K[c, a, b] + ti.cast(left @ block @ left.transpose(), ti.f32)
            for a in range(8):
                for b in range(a + 1):
                    volume = vec3(B[a, 0], B[a, 1], B[a, 2]).outer_product(vec3(B[b, 0], B[b, 1], B[b, 2])) / bulk
                    K[c, a, b] = K[c, a, b] + ti.cast(volume, ti.f32)
                    if b < a:
                        K[c, b, a] = K[c, a, b].transpose()


@ti.kernel
def gather_tangents(
    late: ti.types.ndarray(),
    node_cell: ti.types.ndarray(),
    K: ti.types.ndarray(dtype=mat3f, ndim=3),
    A: ti.types.ndarray(dtype=vec4f, ndim=3),
):
    """Rows of the global tangent on the 27-point stencil, for nodes n with late[n] not zero: A[n, slot] sums the cell
    blocks that couple node n to that neighbour; column j of a block is A[n, slot, j], padded to four."""
    for n in range(node_cell.shape[0]):
        if late[n] == 0:
            continue
        for s in range(27):
            for j in ti.static(range(3)):
                A[n, s, j] = vec4f(0.0)
        for o in range(8):
            c = node_cell[n, o]
            if c >= 0:
                a = 7 - o
                for b in range(8):
                    slot = 9 * (b // 4 - a // 4 + 1) + 3 * ((b // 2) % 2 - (a // 2) % 2 + 1) + (b % 2 - a % 2 + 1)
                    k = K[c, a, b]
                    for j in ti.static(range(3)):
                        A[n, slot, j] = A[n, slot, j] + vec4f(k[0, j], k[1, j], k[2, j], 0.0)


@ti.kernel
def coarse_tangents(
    start: ti.types.ndarray(),
    member: ti.types.ndarray(),
    K: ti.types.ndarray(dtype=vec9f, ndim=3),
    W: ti.types.ndarray(),
    out: ti.types.ndarray(dtype=vec9, ndim=3),
):
    """Galerkin tangents of coarse cells: out[C, A, B] = sum over fine cells and their nodes a, b of W_aA K_ab W_bB.

    member lists the fine cells of each coarse cell, start their ranges; W (c, 8, 8) are the coarse shape values at a
    cell's nodes.
    """
    for row in range(out.shape[0] * 8):
        C, A = row // 8, row % 8
        for B in range(8):
            out[C, A, B] = vec9(0.0)
        for m in range(start[C], start[C + 1]):
            c = member[m]
            for b in range(8):
                row_b = vec9(0.0)
                for a in range(8):
                    if W[c, a, A] != 0.0:
                        row_b += W[c, a, A] * ti.cast(K[c, a, b], ti.f64)
                for B in range(8):
                    if W[c, b, B] != 0.0:
                        out[C, A, B] = out[C, A, B] + W[c, b, B] * row_b
