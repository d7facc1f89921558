"""Elastic forces and their tangent on trilinear cells whose quadrature points are the particles.

Symbols: x node positions, X reference positions, F deformation gradient, R its rotation (polar), J = det F, P first
Piola-Kirchhoff stress, V particle volume, g_a reference gradient of the shape function of local node a.

Fixed-corotated energy [S12, Eq. 3.2]: psi = mu |F - R|^2 + lambda / 2 (J - 1)^2, P = 2 mu (F - R) + lambda (J - 1)
cof F, with the cell's mean volume change in place of J - 1 (mean dilatation, Q1/P0 [N74]) and with bending
as in solver/model/bending.py. The tangent is that at rest, turned with the cell (warped stiffness [M04]), and the
true one without its negative part [S19] where strain is large.

[S12] Stomakhin, Howes, Schroeder, Teran: Energetically consistent invertible elasticity. SCA 2012.
[M04] Mueller, Gross: Interactive virtual materials. Graphics Interface 2004.
[M16] Mueller, Bender, Chentanez, Macklin: A robust method to extract the rotational part of deformations. MIG 2016.
[N74] Nagtegaal, Parks, Rice: On numerically accurate finite element solutions in the fully plastic range. Comput.
Methods Appl. Mech. Eng. 4, 1974.
[S19] Smith, de Goes, Kim: Analytic eigensystems for isotropic distortion energies. ACM Trans. Graph. 38(1), 2019.
[G13] Golub, Van Loan: Matrix Computations, 4th ed. Johns Hopkins 2013.
[H86] Higham: Computing the polar decomposition, with applications. SIAM J. Sci. Stat. Comput. 7(4), 1986.
"""

import taichi as ti

from solver.model.bending import MODES

vec3 = ti.types.vector(3, ti.f64)
mat3 = ti.types.matrix(3, 3, ti.f64)
mat3f = ti.types.matrix(3, 3, ti.f32)
vec4f = ti.types.vector(4, ti.f32)
vec9 = ti.types.vector(9, ti.f64)
vec9f = ti.types.vector(9, ti.f32)
mat83 = ti.types.matrix(8, 3, ti.f64)

SIDE = tuple(tuple(2.0 * (a >> shift & 1) - 1.0 for shift in (2, 1, 0)) for a in range(8))
"""-1 or 1 per axis for local node a = 4 i + 2 j + k."""
POLAR_TOLERANCE = 1e-13  # squared change at which the polar iteration stops: what is left is rounding
POLAR_ITERATIONS = 20  # Newton converges quadratically: 6 suffice up to a stretch of 10
SMALLEST_BULK = 1e-300  # [N m], so that nu = 0 divides by something
JACOBI_SWEEPS = 6  # converge quadratically: four reach rounding
JACOBI_SMALL = 1e-16  # of the diagonal: nothing left to rotate away
SMALLEST_STRETCH = 1e-3  # sum of two singular values [-] below which a particle is inside out
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
    """shape_gradient of all eight local nodes, one per row."""
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
    `tolerance` [H86]; it converges quadratically, so the error left is half of that."""
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
def add_bending_relief(X: mat83, h: vec3, relief: ti.types.ndarray(), c: ti.i32, total: ti.template()) -> ti.f64:
    """Adds dE/dx of the relief to `total` (8, 3) and returns its energy E; modes as in solver/model/bending.py."""
    f, a = ti.Matrix.zero(ti.f64, 3, 3), ti.Matrix.zero(ti.f64, 3, 3)  # rows: f_x, f_y, f_z and a_xy, a_xz, a_yz
    for n in ti.static(range(8)):
        for d in ti.static(range(3)):
            f[0, d] += ti.static(SIDE[n][0]) * X[n, d]
            f[1, d] += ti.static(SIDE[n][1]) * X[n, d]
            f[2, d] += ti.static(SIDE[n][2]) * X[n, d]
            a[0, d] += ti.static(SIDE[n][0]) * ti.static(SIDE[n][1]) * X[n, d]
            a[1, d] += ti.static(SIDE[n][0]) * ti.static(SIDE[n][2]) * X[n, d]
            a[2, d] += ti.static(SIDE[n][1]) * ti.static(SIDE[n][2]) * X[n, d]
    on_f, on_a = ti.Matrix.zero(ti.f64, 3, 3), ti.Matrix.zero(ti.f64, 3, 3)
    q = ti.Vector.zero(ti.f64, 6)
    for m in ti.static(range(6)):
        i = ti.static(MODES[m][0])
        pair = ti.static(sum(MODES[m]) - 1)
        for d in ti.static(range(3)):
            q[m] += f[i, d] * a[pair, d]
        q[m] *= 0.25 / h[i] * 0.125
    energy = 0.0
    for m in ti.static(range(6)):
        i = ti.static(MODES[m][0])
        pair = ti.static(sum(MODES[m]) - 1)
        push = relief[c, m] * q[m] + relief[c, ti.static(6 + m // 2)] * q[ti.static(m ^ 1)]
        energy -= 0.5 * push * q[m]
        push *= 0.25 / h[i] * 0.125
        for d in ti.static(range(3)):
            on_f[i, d] += push * a[pair, d]
            on_a[pair, d] += push * f[i, d]
    for n in ti.static(range(8)):
        for d in ti.static(range(3)):
            total[n, d] -= (
                ti.static(SIDE[n][0]) * on_f[0, d]
                + ti.static(SIDE[n][1]) * on_f[1, d]
                + ti.static(SIDE[n][2]) * on_f[2, d]
            )
            total[n, d] -= ti.static(SIDE[n][0]) * (
                ti.static(SIDE[n][1]) * on_a[0, d] + ti.static(SIDE[n][2]) * on_a[1, d]
            )
            total[n, d] -= ti.static(SIDE[n][1]) * ti.static(SIDE[n][2]) * on_a[2, d]
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
    """Per cell: deformation, rotation and energy of its particles, and the forces -V P g_a on its 8 nodes, less the
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
        relieved = add_bending_relief(X, h, relief, c, total) / material
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
    B_a = sum V lambda g_a, less the second derivative of the relief."""
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
    cell_start: ti.types.ndarray(),
    V: ti.types.ndarray(),
    R: ti.types.ndarray(),
    K_rest: ti.types.ndarray(dtype=mat3f, ndim=3),
    K: ti.types.ndarray(dtype=mat3f, ndim=3),
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
                k = Q @ ti.cast(K_rest[c, a, b], ti.f64) @ Q.transpose()
                K[c, a, b] = ti.cast(k, ti.f32)
                K[c, b, a] = ti.cast(k.transpose(), ti.f32)


@ti.func
def eigen(A: mat3):
    """Eigenvalues and eigenvectors (columns) of a symmetric matrix by cyclic Jacobi rotations [G13, Sec. 8.5]; unlike
    closed forms it stays exact where eigenvalues coincide, as they do under a round body."""
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
    last: ti.i32,
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
    """Replaces the tangents of cells first <= c < last in which a particle is strained by more than `limit` by their
    own second derivative, without its negative part: in the basis of singular vectors it is diagonal but for a 3 x 3
    block [S19, Sec. 5]. The relief of bending is left out of it."""
    for c in range(first, last):
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
    node_cell: ti.types.ndarray(),
    K: ti.types.ndarray(dtype=mat3f, ndim=3),
    A: ti.types.ndarray(dtype=vec4f, ndim=3),
):
    """Rows of the global tangent on the 27-point stencil: A[n, slot] sums the cell blocks that couple node n to that
    neighbour; column j of a block is A[n, slot, j], padded to four."""
    for n in range(node_cell.shape[0]):
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

    member lists the fine cells of each coarse cell, start their ranges; W (c, 8, 8) are the coarse shape values
    at a cell's nodes.
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
