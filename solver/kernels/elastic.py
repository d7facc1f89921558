"""Elastic forces and their tangent on trilinear cells whose quadrature points are the particles.

Symbols: x node positions, X reference positions, F deformation gradient, R its rotation (polar), J = det F, P first
Piola-Kirchhoff stress, V particle volume, g_a reference gradient of the shape function of local node a.

Fixed-corotated energy [S12, Eq. 3.2]: psi = mu |F - R|^2 + lambda / 2 (J - 1)^2, P = 2 mu (F - R) + lambda (J - 1)
cof F, with the cell's mean volume change in place of J - 1 (mean dilatation, Q1/P0 [N74]). The tangent is the positive
semi-definite part that warped stiffness keeps [M04]: rotation frozen in the shear term, cof F in the volume term. It
is exact at F = R.

[S12] Stomakhin, Howes, Schroeder, Teran: Energetically consistent invertible elasticity. SCA 2012.
[M04] Mueller, Gross: Interactive virtual materials. Graphics Interface 2004.
[M16] Mueller, Bender, Chentanez, Macklin: A robust method to extract the rotational part of deformations. MIG 2016.
[N74] Nagtegaal, Parks, Rice: On numerically accurate finite element solutions in the fully plastic range. Comput.
Methods Appl. Mech. Eng. 4, 1974.
[H86] Higham: Computing the polar decomposition, with applications. SIAM J. Sci. Stat. Comput. 7(4), 1986.
"""

import taichi as ti

vec3 = ti.types.vector(3, ti.f64)
mat3 = ti.types.matrix(3, 3, ti.f64)

POLAR_TOLERANCE = 1e-12  # relative change at which Newton's polar iteration stops: float64 rounding of a 3x3 product
POLAR_ITERATIONS = 20  # Newton converges quadratically: 6 suffice up to a stretch of 10
SMALLEST_BULK = 1e-300  # [N m], so that nu = 0 divides by something
INVERTED = 1e-6  # below this J the Newton iteration is ill-conditioned; the warm-started iteration [M16] takes over


@ti.func
def shape_gradient(a: ti.i32, xi: vec3, h: vec3) -> vec3:
    """Reference gradient [1/m] of the trilinear shape function of local node a = 4 i + 2 j + k at xi in [0, 1]^3."""
    i, j, k = a // 4, (a // 2) % 2, a % 2
    nx = xi[0] if i == 1 else 1.0 - xi[0]
    ny = xi[1] if j == 1 else 1.0 - xi[1]
    nz = xi[2] if k == 1 else 1.0 - xi[2]
    sx = (2.0 * i - 1.0) / h[0]
    sy = (2.0 * j - 1.0) / h[1]
    sz = (2.0 * k - 1.0) / h[2]
    return vec3(sx * ny * nz, nx * sy * nz, nx * ny * sz)


@ti.func
def cofactor(F: mat3) -> mat3:
    """cof F = J F^-T, from cross products of the columns, defined for singular F too."""
    c0 = vec3(F[0, 0], F[1, 0], F[2, 0])
    c1 = vec3(F[0, 1], F[1, 1], F[2, 1])
    c2 = vec3(F[0, 2], F[1, 2], F[2, 2])
    a, b, c = c1.cross(c2), c2.cross(c0), c0.cross(c1)
    return mat3([[a[0], b[0], c[0]], [a[1], b[1], c[1]], [a[2], b[2], c[2]]])


@ti.func
def rotation_by_newton(F: mat3) -> mat3:
    """Polar rotation of F, J > 0: R <- (R + R^-T) / 2 [H86]."""
    R = F
    change = 1.0
    count = 0
    while change > POLAR_TOLERANCE and count < POLAR_ITERATIONS:
        C = cofactor(R)
        J = R[0, 0] * C[0, 0] + R[1, 0] * C[1, 0] + R[2, 0] * C[2, 0]
        N = 0.5 * (R + C / J)
        change = (N - R).norm_sqr()
        R = N
        count += 1
    return R


@ti.func
def rotation_by_torque(F: mat3, R0: mat3) -> mat3:
    """Rotation nearest to F for any sign of J, warm-started at R0 [M16, Alg. 1]."""
    R = R0
    for _ in range(POLAR_ITERATIONS):
        axis = vec3(0.0, 0.0, 0.0)
        scale = 1e-12
        for c in ti.static(range(3)):
            r = vec3(R[0, c], R[1, c], R[2, c])
            f = vec3(F[0, c], F[1, c], F[2, c])
            axis += r.cross(f)
            scale += r.dot(f)
        omega = axis / ti.abs(scale)
        angle = omega.norm()
        if angle > 1e-12:
            n = omega / angle
            K = mat3([[0.0, -n[2], n[1]], [n[2], 0.0, -n[0]], [-n[1], n[0], 0.0]])
            R = (ti.Matrix.identity(ti.f64, 3) + ti.sin(angle) * K + (1.0 - ti.cos(angle)) * (K @ K)) @ R
    return R


@ti.func
def load3(A: ti.template(), p: ti.i32) -> mat3:
    """Row-major 3x3 block p of A, shape (n, 9)."""
    return mat3([[A[p, 0], A[p, 1], A[p, 2]], [A[p, 3], A[p, 4], A[p, 5]], [A[p, 6], A[p, 7], A[p, 8]]])


@ti.kernel
def cell_forces(
    x: ti.types.ndarray(),
    cell_node: ti.types.ndarray(),
    cell_size: ti.types.ndarray(),
    cell_start: ti.types.ndarray(),
    xi: ti.types.ndarray(),
    V: ti.types.ndarray(),
    mu: ti.types.ndarray(),
    lam: ti.types.ndarray(),
    R: ti.types.ndarray(),
    F_out: ti.types.ndarray(),
    J_out: ti.types.ndarray(),
    psi: ti.types.ndarray(),
    force: ti.types.ndarray(),
):
    """Per cell: deformation, rotation and energy of its particles, and the forces -V P g_a on its 8 nodes.

    The volume change is that of the cell as a whole, weighted by V lambda: pointwise it would lock for nu -> 1/2.
    """
    for c in range(cell_node.shape[0]):
        h = vec3(cell_size[c, 0], cell_size[c, 1], cell_size[c, 2])
        for a in range(8):
            for d in ti.static(range(3)):
                force[c, a, d] = 0.0
        dilation, bulk = 0.0, 0.0
        for p in range(cell_start[c], cell_start[c + 1]):
            s = vec3(xi[p, 0], xi[p, 1], xi[p, 2])
            F = ti.Matrix.zero(ti.f64, 3, 3)
            for a in range(8):
                n = cell_node[c, a]
                F += vec3(x[n, 0], x[n, 1], x[n, 2]).outer_product(shape_gradient(a, s, h))
            C = cofactor(F)
            J = F[0, 0] * C[0, 0] + F[1, 0] * C[1, 0] + F[2, 0] * C[2, 0]
            Q = load3(R, p)
            if J > INVERTED:  # noqa: SIM108  a kernel must not evaluate both
                Q = rotation_by_newton(F)
            else:
                Q = rotation_by_torque(F, Q)
            J_out[p] = J
            dilation += V[p] * lam[p] * (J - 1.0)
            bulk += V[p] * lam[p]
            for i in ti.static(range(3)):
                for j in ti.static(range(3)):
                    R[p, 3 * i + j] = Q[i, j]
                    F_out[p, 3 * i + j] = F[i, j]
        dilation /= bulk + SMALLEST_BULK
        for p in range(cell_start[c], cell_start[c + 1]):
            s = vec3(xi[p, 0], xi[p, 1], xi[p, 2])
            F = load3(F_out, p)
            D = F - load3(R, p)
            P = V[p] * (2.0 * mu[p] * D + lam[p] * dilation * cofactor(F))
            psi[p] = V[p] * (mu[p] * D.norm_sqr() + 0.5 * lam[p] * dilation**2)
            for a in range(8):
                f = P @ shape_gradient(a, s, h)
                for d in ti.static(range(3)):
                    force[c, a, d] -= f[d]


@ti.kernel
def gather_forces(node_cell: ti.types.ndarray(), force: ti.types.ndarray(), f: ti.types.ndarray()):
    """Node force = sum over its (up to) 8 cells; slot o of a node is the cell in which it is local node 7 - o."""
    for n in range(node_cell.shape[0]):
        total = vec3(0.0, 0.0, 0.0)
        for o in range(8):
            c = node_cell[n, o]
            if c >= 0:
                total += vec3(force[c, 7 - o, 0], force[c, 7 - o, 1], force[c, 7 - o, 2])
        for d in ti.static(range(3)):
            f[n, d] = total[d]


@ti.kernel
def cell_tangents(
    cell_size: ti.types.ndarray(),
    cell_start: ti.types.ndarray(),
    xi: ti.types.ndarray(),
    V: ti.types.ndarray(),
    mu: ti.types.ndarray(),
    lam: ti.types.ndarray(),
    R: ti.types.ndarray(),
    F: ti.types.ndarray(),
    K: ti.types.ndarray(),
):
    """Per cell the 8 x 8 blocks K_ab = sum V mu [(g_a . g_b) I + (R g_b)(R g_a)^T] + B_a B_b^T / sum V lambda with
    B_a = sum V lambda C g_a, C = cof F."""
    for c in range(cell_size.shape[0]):
        h = vec3(cell_size[c, 0], cell_size[c, 1], cell_size[c, 2])
        B = ti.Matrix.zero(ti.f64, 8, 3)
        bulk = SMALLEST_BULK
        for a in range(8):
            for b in range(8):
                for d in range(9):
                    K[c, a, b, d] = ti.cast(0.0, ti.f32)
        for p in range(cell_start[c], cell_start[c + 1]):
            s = vec3(xi[p, 0], xi[p, 1], xi[p, 2])
            Q = load3(R, p)
            C = cofactor(load3(F, p))
            m, la = V[p] * mu[p], V[p] * lam[p]
            bulk += la
            for a in ti.static(range(8)):
                ga = shape_gradient(a, s, h)
                ca = la * (C @ ga)
                for d in ti.static(range(3)):
                    B[a, d] += ca[d]
            for a in range(8):
                ga = shape_gradient(a, s, h)
                ra = m * (Q @ ga)
                for b in range(a + 1):
                    gb = shape_gradient(b, s, h)
                    rb = Q @ gb
                    dot = m * ga.dot(gb)
                    for i in ti.static(range(3)):
                        for j in ti.static(range(3)):
                            v = rb[i] * ra[j]
                            if ti.static(i == j):
                                v += dot
                            K[c, a, b, 3 * i + j] += ti.cast(v, ti.f32)
        for a in ti.static(range(8)):
            for b in ti.static(range(a + 1)):
                for i in ti.static(range(3)):
                    for j in ti.static(range(3)):
                        K[c, a, b, 3 * i + j] += ti.cast(B[a, i] * B[b, j] / bulk, ti.f32)
        for a in range(8):
            for b in range(a):
                for i in ti.static(range(3)):
                    for j in ti.static(range(3)):
                        K[c, b, a, 3 * j + i] = K[c, a, b, 3 * i + j]


@ti.kernel
def turn_tangents(
    cell_start: ti.types.ndarray(),
    V: ti.types.ndarray(),
    R: ti.types.ndarray(),
    K_rest: ti.types.ndarray(),
    K: ti.types.ndarray(),
):
    """Warped stiffness of each cell: K_ab = R K_ab(rest) R^T with the volume average R of its particles'
    rotations [M04]."""
    for c in range(K.shape[0]):
        Q = ti.Matrix.zero(ti.f64, 3, 3)
        total = 0.0
        for p in range(cell_start[c], cell_start[c + 1]):
            Q += V[p] * load3(R, p)
            total += V[p]
        Q /= total
        for a in range(8):
            for b in range(a + 1):
                k = ti.Matrix.zero(ti.f64, 3, 3)
                for i in ti.static(range(3)):
                    for j in ti.static(range(3)):
                        k[i, j] = ti.cast(K_rest[c, a, b, 3 * i + j], ti.f64)
                k = Q @ k @ Q.transpose()
                for i in ti.static(range(3)):
                    for j in ti.static(range(3)):
                        K[c, a, b, 3 * i + j] = ti.cast(k[i, j], ti.f32)
                        K[c, b, a, 3 * j + i] = ti.cast(k[i, j], ti.f32)


@ti.kernel
def gather_tangents(node_cell: ti.types.ndarray(), K: ti.types.ndarray(), A: ti.types.ndarray()):
    """Rows of the global tangent on the 27-point stencil: A[n, slot] sums the cell blocks that couple node n to
    that neighbour."""
    for n in range(node_cell.shape[0]):
        for s in range(27):
            for d in range(9):
                A[n, s, d] = ti.cast(0.0, ti.f32)
        for o in range(8):
            c = node_cell[n, o]
            if c >= 0:
                a = 7 - o
                for b in range(8):
                    slot = 9 * (b // 4 - a // 4 + 1) + 3 * ((b // 2) % 2 - (a // 2) % 2 + 1) + (b % 2 - a % 2 + 1)
                    for d in range(9):
                        A[n, slot, d] += K[c, a, b, d]


@ti.kernel
def coarse_tangents(
    start: ti.types.ndarray(),
    member: ti.types.ndarray(),
    K: ti.types.ndarray(),
    W: ti.types.ndarray(),
    scratch: ti.types.ndarray(),
    out: ti.types.ndarray(),
):
    """Galerkin tangents of coarse cells: out[C, A, B] = sum over fine cells and their nodes a, b of W_aA K_ab W_bB.

    member lists the fine cells of each coarse cell, start their ranges; W (c, 8, 8) are the coarse shape values
    at a cell's nodes.
    """
    for row in range(out.shape[0] * 8):
        C, A = row // 8, row % 8
        for B in range(8):
            for d in range(9):
                out[C, A, B, d] = 0.0
        for m in range(start[C], start[C + 1]):
            c = member[m]
            for b in range(8):
                for d in range(9):
                    scratch[row, b, d] = 0.0
                for a in range(8):
                    w = W[c, a, A]
                    if w != 0.0:
                        for d in range(9):
                            scratch[row, b, d] += w * K[c, a, b, d]
            for B in range(8):
                for b in range(8):
                    w = W[c, b, B]
                    if w != 0.0:
                        for d in range(9):
                            out[C, A, B, d] += w * scratch[row, b, d]
