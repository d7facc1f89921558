"""Stiffness-proportional damping as a function of two states, unaffected by rotation.

Over a step of dt from stretches S0 to S (F = R S) the drag is the gradient of

    D = beta / dt ( mu |S - S0|^2 + lambda / 2 (J - J0)^2 + E_relief(q - q0) )

summed over volume: the elastic energy of the strain that the step adds. J is the cell's mean volume change, q are the
bending modes of solver/model/bending.py. Its second derivative at S = S0 is beta / dt times that of elasticity. S, J
and q do not change in a rigid motion, so a turning body feels no drag and loses no angular momentum.

With S : S0 as a function of F, and skew(a) x = a cross x,

    d(S : S0) / dF = R (S0 - 2 skew(z)) ,   (tr(S) I - S) z = axial((S0 S - S S0) / 2)

from the derivative of the polar rotation [B11, appendix].

[B11] Barbic, Zhao: Real-time large-deformation substructuring. ACM Trans. Graph. 30(4), 2011.
"""

import taichi as ti

from solver.kernels.elastic import (
    SMALLEST_BULK,
    add_bending_relief,
    bending_amplitudes,
    bending_slopes,
    cofactor,
    load3,
    mat3,
    mat83,
    shape_gradients,
    vec3,
)

AMBIGUOUS = 1e-3  # least det(tr(S) I - S) / |S|^3: below it, in inverted particles, the rotation is undetermined


@ti.func
def cell_corners(x: ti.template(), cell_node: ti.template(), c: ti.i32) -> mat83:
    X = ti.Matrix.zero(ti.f64, 8, 3)
    for a in ti.static(range(8)):
        n = cell_node[c, a]
        X[a, 0], X[a, 1], X[a, 2] = x[n, 0], x[n, 1], x[n, 2]
    return X


@ti.kernel
def start_strains(
    x: ti.types.ndarray(),
    cell_node: ti.types.ndarray(),
    cell_size: ti.types.ndarray(),
    F: ti.types.ndarray(),
    R: ti.types.ndarray(),
    stretch: ti.types.ndarray(),
    modes: ti.types.ndarray(),
):
    """Stretches S0 (p, 9) of the particles and bending amplitudes (c, 6) of the cells at a state."""
    for p in range(stretch.shape[0]):
        S = load3(R, p).transpose() @ load3(F, p)
        for i in ti.static(range(3)):
            for j in ti.static(range(3)):
                stretch[p, 3 * i + j] = 0.5 * (S[i, j] + S[j, i])
    for c in range(modes.shape[0]):
        h = vec3(cell_size[c, 0], cell_size[c, 1], cell_size[c, 2])
        q = bending_amplitudes(bending_slopes(cell_corners(x, cell_node, c)), h)
        for m in ti.static(range(6)):
            modes[c, m] = q[m]


@ti.func
def turn_correction(S: mat3, S0: mat3) -> mat3:
    """2 skew(z) as above."""
    out = mat3(0.0)
    G = (S[0, 0] + S[1, 1] + S[2, 2]) * ti.Matrix.identity(ti.f64, 3) - S
    size = S.norm()
    C = cofactor(G)
    J = G[0, 0] * C[0, 0] + G[1, 0] * C[1, 0] + G[2, 0] * C[2, 0]
    if AMBIGUOUS * size * size * size < J:
        A = 0.5 * (S0 @ S - S @ S0)
        z = (C.transpose() / J) @ vec3(A[2, 1], A[0, 2], A[1, 0])
        out = 2.0 * mat3([[0.0, -z[2], z[1]], [z[2], 0.0, -z[0]], [-z[1], z[0], 0.0]])
    return out


@ti.kernel
def add_drag(
    rate: ti.f64,
    x: ti.types.ndarray(),
    cell_node: ti.types.ndarray(),
    cell_size: ti.types.ndarray(),
    cell_start: ti.types.ndarray(),
    xi: ti.types.ndarray(),
    V: ti.types.ndarray(),
    mu: ti.types.ndarray(),
    lam: ti.types.ndarray(),
    relief: ti.types.ndarray(),
    F_in: ti.types.ndarray(),
    R: ti.types.ndarray(),
    stretch: ti.types.ndarray(),
    modes: ti.types.ndarray(),
    force: ti.types.ndarray(),
):
    """Adds the drag with rate = beta / dt to the forces on each cell's nodes; F_in and R belong to x, stretch and modes
    to the start of the step."""
    for c in range(cell_node.shape[0]):
        h = vec3(cell_size[c, 0], cell_size[c, 1], cell_size[c, 2])
        growth, bulk = 0.0, 0.0
        for p in range(cell_start[c], cell_start[c + 1]):
            growth += V[p] * lam[p] * (load3(F_in, p).determinant() - load3(stretch, p).determinant())
            bulk += V[p] * lam[p]
        growth /= bulk + SMALLEST_BULK
        total = ti.Matrix.zero(ti.f64, 8, 3)
        slopes = bending_slopes(cell_corners(x, cell_node, c))
        q = bending_amplitudes(slopes, h)
        for m in ti.static(range(6)):
            q[m] -= modes[c, m]
        add_bending_relief(slopes, q, h, relief, c, total)
        for p in range(cell_start[c], cell_start[c + 1]):
            G = shape_gradients(vec3(xi[p, 0], xi[p, 1], xi[p, 2]), h)
            F, Q, S0 = load3(F_in, p), load3(R, p), load3(stretch, p)
            S = Q.transpose() @ F
            S = 0.5 * (S + S.transpose())
            P = V[p] * (2.0 * mu[p] * (Q @ (S - S0 + turn_correction(S, S0))) + lam[p] * growth * cofactor(F))
            total += G @ P.transpose()
        for a in ti.static(range(8)):
            for d in ti.static(range(3)):
                force[c, a, d] -= rate * total[a, d]
