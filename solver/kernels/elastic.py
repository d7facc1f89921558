"""Elastic forces on trilinear cells whose quadrature points are the particles.

Symbols: x node positions, X reference positions, F deformation gradient, R its rotation (polar), J = det F, P first
Piola-Kirchhoff stress, V particle volume, g_a reference gradient of the shape function of local node a.

Fixed-corotated energy [S12, Eq. 3.2]: psi = mu |F - R|^2 + lambda / 2 (J - 1)^2, P = 2 mu (F - R) + lambda (J - 1)
cof F, with the cell's mean volume change in place of J - 1 (mean dilatation, Q1/P0 [N74]) and with bending
as in solver/model/bending.py. Their tangent is in tangents.py.

[S12] Stomakhin, Howes, Schroeder, Teran: Energetically consistent invertible elasticity. SCA 2012.
[M16] Mueller, Bender, Chentanez, Macklin: A robust method to extract the rotational part of deformations. MIG 2016.
[N74] Nagtegaal, Parks, Rice: On numerically accurate finite element solutions in the fully plastic range. Comput.
Methods Appl. Mech. Eng. 4, 1974.
[H86] Higham: Computing the polar decomposition, with applications. SIAM J. Sci. Stat. Comput. 7(4), 1986.
"""

import taichi as ti

from solver.model.bending import MODES

vec3 = ti.types.vector(3, ti.f64)
mat3 = ti.types.matrix(3, 3, ti.f64)
mat3f = ti.types.matrix(3, 3, ti.f32)
vec4f = ti.types.vector(4, ti.f32)
mat63 = ti.types.matrix(6, 3, ti.f64)
mat83 = ti.types.matrix(8, 3, ti.f64)
vec6 = ti.types.vector(6, ti.f64)

SIDE = tuple(tuple(2.0 * (a >> shift & 1) - 1.0 for shift in (2, 1, 0)) for a in range(8))
"""-1 or 1 per axis for local node a = 4 i + 2 j + k."""
POLAR_TOLERANCE = 1e-13  # squared change at which the polar iteration stops: the remainder is rounding
POLAR_ITERATIONS = 20  # Newton converges quadratically: 6 suffice up to a stretch of 10
SMALLEST_BULK = 1e-300  # [N m], avoids division by zero for nu = 0
INVERTED = 1e-6  # below this J the Newton iteration is ill-conditioned; the warm-started iteration [M16] takes over


@ti.func
def side(a: ti.i32, axis: ti.template()) -> ti.f64:
    """SIDE[a][axis] for a node that is known only at run time."""
    return 2.0 * ((a >> (2 - axis)) & 1) - 1.0


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
def shape_gradients(xi: vec3, h: vec3) -> mat83:
    """Values of shape_gradient for all eight local nodes, one per row."""
    u = ti.Matrix([[1.0 - xi[0], xi[0]], [1.0 - xi[1], xi[1]], [1.0 - xi[2], xi[2]]])
    s = ti.Matrix([[-1.0 / h[0], 1.0 / h[0]], [-1.0 / h[1], 1.0 / h[1]], [-1.0 / h[2], 1.0 / h[2]]])
    G = ti.Matrix.zero(ti.f64, 8, 3)
    for i in ti.static(range(2)):
        for j in ti.static(range(2)):
            for k in ti.static(range(2)):
                G[4 * i + 2 * j + k, 0] = s[0, i] * u[1, j] * u[2, k]
                G[4 * i + 2 * j + k, 1] = u[0, i] * s[1, j] * u[2, k]
                G[4 * i + 2 * j + k, 2] = u[0, i] * u[1, j] * s[2, k]
    return G


@ti.func
def cofactor(F: mat3) -> mat3:
    """cof F = J F^-T, from cross products of the columns, defined for singular F too."""
    c0 = vec3(F[0, 0], F[1, 0], F[2, 0])
    c1 = vec3(F[0, 1], F[1, 1], F[2, 1])
    c2 = vec3(F[0, 2], F[1, 2], F[2, 2])
    a, b, c = c1.cross(c2), c2.cross(c0), c0.cross(c1)
    return mat3([[a[0], b[0], c[0]], [a[1], b[1], c[1]], [a[2], b[2], c[2]]])


@ti.func
def rotation_by_newton(F: mat3, C: mat3, J: ti.f64, tolerance: ti.f64) -> mat3:
    """Polar rotation of F with cofactor matrix C and J = det F > 0: R <- (R + R^-T) / 2 until the squared change is
    below `tolerance` [H86]; convergence is quadratic, so the remaining error is half of that."""
    R = 0.5 * (F + (1.0 / J) * C)
    change = (R - F).norm_sqr()
    count = 1
    while change > tolerance and count < POLAR_ITERATIONS:
        D = cofactor(R)
        inverse = 1.0 / (R[0, 0] * D[0, 0] + R[1, 0] * D[1, 0] + R[2, 0] * D[2, 0])
        N = 0.5 * (R + inverse * D)
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


@ti.func
def bending_slopes(X: mat83) -> mat63:
    """Rows f_x, f_y, f_z, then a_xy, a_xz, a_yz of a cell, as in solver/model/bending.py up to factors of h and 8."""
    out = ti.Matrix.zero(ti.f64, 6, 3)
    for n in ti.static(range(8)):
        for d in ti.static(range(3)):
            out[0, d] += ti.static(SIDE[n][0]) * X[n, d]
            out[1, d] += ti.static(SIDE[n][1]) * X[n, d]
            out[2, d] += ti.static(SIDE[n][2]) * X[n, d]
            out[3, d] += ti.static(SIDE[n][0]) * ti.static(SIDE[n][1]) * X[n, d]
            out[4, d] += ti.static(SIDE[n][0]) * ti.static(SIDE[n][2]) * X[n, d]
            out[5, d] += ti.static(SIDE[n][1]) * ti.static(SIDE[n][2]) * X[n, d]
    return out


@ti.func
def bending_amplitudes(slopes: mat63, h: vec3) -> vec6:
    """Amplitudes q_ij of a cell's bending modes, in the order of MODES."""
    q = ti.Vector.zero(ti.f64, 6)
    for m in ti.static(range(6)):
        i = ti.static(MODES[m][0])
        pair = ti.static(2 + sum(MODES[m]))
        for d in ti.static(range(3)):
            q[m] += slopes[i, d] * slopes[pair, d]
        q[m] *= 0.25 / h[i] * 0.125
    return q


@ti.func
def add_bending_relief(
    slopes: mat63, q: vec6, h: vec3, relief: ti.types.ndarray(), c: ti.i32, total: ti.template()
) -> ti.f64:
    """Adds dE/dx of the relief at amplitudes `q` to `total` (8, 3) and returns its energy E."""
    back = ti.Matrix.zero(ti.f64, 6, 3)
    energy = 0.0
    for m in ti.static(range(6)):
        i = ti.static(MODES[m][0])
        pair = ti.static(2 + sum(MODES[m]))
        push = relief[c, m] * q[m] + relief[c, ti.static(6 + m // 2)] * q[ti.static(m ^ 1)]
        energy -= 0.5 * push * q[m]
        push *= 0.25 / h[i] * 0.125
        for d in ti.static(range(3)):
            back[i, d] += push * slopes[pair, d]
            back[pair, d] += push * slopes[i, d]
    for n in ti.static(range(8)):
        for d in ti.static(range(3)):
            total[n, d] -= (
                ti.static(SIDE[n][0]) * back[0, d]
                + ti.static(SIDE[n][1]) * back[1, d]
                + ti.static(SIDE[n][2]) * back[2, d]
            )
            total[n, d] -= ti.static(SIDE[n][0]) * (
                ti.static(SIDE[n][1]) * back[3, d] + ti.static(SIDE[n][2]) * back[4, d]
            )
            total[n, d] -= ti.static(SIDE[n][1]) * ti.static(SIDE[n][2]) * back[5, d]
    return energy


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
    relief: ti.types.ndarray(),
    R: ti.types.ndarray(),
    F_out: ti.types.ndarray(),
    J_out: ti.types.ndarray(),
    psi: ti.types.ndarray(),
    force: ti.types.ndarray(),
):
    """Per cell: deformation, rotation and energy of its particles, and the forces -V P g_a on its 8 nodes, minus the
    relief's.

    The volume change is that of the cell as a whole, weighted by V lambda: pointwise it would lock for nu -> 1/2.
    """
    for c in range(cell_node.shape[0]):
        h = vec3(cell_size[c, 0], cell_size[c, 1], cell_size[c, 2])
        X = ti.Matrix.zero(ti.f64, 8, 3)
        for a in ti.static(range(8)):
            n = cell_node[c, a]
            X[a, 0], X[a, 1], X[a, 2] = x[n, 0], x[n, 1], x[n, 2]
        dilation, bulk, material = 0.0, 0.0, 0.0
        for p in range(cell_start[c], cell_start[c + 1]):
            G = shape_gradients(vec3(xi[p, 0], xi[p, 1], xi[p, 2]), h)
            F = X.transpose() @ G
            C = cofactor(F)
            J = F[0, 0] * C[0, 0] + F[1, 0] * C[1, 0] + F[2, 0] * C[2, 0]
            Q = load3(R, p)
            if J > INVERTED:  # noqa: SIM108  a kernel must not evaluate both
                Q = rotation_by_newton(F, C, J, POLAR_TOLERANCE)
            else:
                Q = rotation_by_torque(F, Q)
            J_out[p] = J
            dilation += V[p] * lam[p] * (J - 1.0)
            bulk += V[p] * lam[p]
            material += V[p]
            for i in ti.static(range(3)):
                for j in ti.static(range(3)):
                    R[p, 3 * i + j] = Q[i, j]
                    F_out[p, 3 * i + j] = F[i, j]
        dilation /= bulk + SMALLEST_BULK
        total = ti.Matrix.zero(ti.f64, 8, 3)
        slopes = bending_slopes(X)
        relieved = add_bending_relief(slopes, bending_amplitudes(slopes, h), h, relief, c, total) / material
        for p in range(cell_start[c], cell_start[c + 1]):
            G = shape_gradients(vec3(xi[p, 0], xi[p, 1], xi[p, 2]), h)
            F = load3(F_out, p)
            D = F - load3(R, p)
            P = V[p] * (2.0 * mu[p] * D + lam[p] * dilation * cofactor(F))
            psi[p] = V[p] * (mu[p] * D.norm_sqr() + 0.5 * lam[p] * dilation**2 + relieved)
            total += G @ P.transpose()
        for a in ti.static(range(8)):
            for d in ti.static(range(3)):
                force[c, a, d] = -total[a, d]


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
