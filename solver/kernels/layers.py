"""Additional forces and tangents of layers on top of elastic.py and tangents.py; law and constants in model/layers.py.

Symbols: f_1, f_2, f_3 = F T, the columns of the deformation gradient along the layers' frame T (two directions in the
layers, and their normal); A = |f_1 x f_2| and m = f_1 x f_2 / A, current area and normal of the layers; H = f_3 . m
their distance; d = f_1 + m x f_2 and e = f_1 - m x f_2, whose lengths are the difference and the sum of the principal
stretches of the layers, since a plane map is a conformal and an anticonformal one. So

    a = |e| - 2 ,   w = H - 1 ,   |d| ,   s = f_3 - H m
    psi = 1/2 (K_aa a^2 + 2 K_aw a w + K_ww w^2 + k_d |d|^2 + k_s |s|^2)

F is not decomposed by iteration; psi depends only on lengths and products of the f_i, so it is objective, and it is
defined for det F <= 0, where H < 0 resists.

The tangent is sum_rs C_rs (d measure_r / dF) (d measure_s / dF)^T with the measures a, w, d, s in a frame that turns
with the layers, at the current F: the complete second derivative at rest, never negative, and without resistance to a
rotation. The contribution of the stress is left out.
"""

import taichi as ti

from solver.kernels.elastic import load3, mat3, mat3f, shape_gradients, vec3, vec6

LEAST_AREA = 1e-6  # of the layers' area: a layer without area has no normal
LEAST_STRETCH = 1e-6  # of the sum of its stretches [-]


@ti.func
def column(f: mat3, k: ti.template()) -> vec3:
    """Column k of a matrix."""
    return vec3(f[0, k], f[1, k], f[2, k])


@ti.func
def layer_law(F: mat3, T: mat3, added: ti.template(), p: ti.i32):
    """First Piola-Kirchhoff stress of the layers with frame T and constants added[p], and twice its energy density."""
    f = F @ T
    f1, f2, f3 = column(f, 0), column(f, 1), column(f, 2)
    m = f1.cross(f2)
    A = ti.max(m.norm(), LEAST_AREA)
    m /= A
    H = f3.dot(m)
    s = f3 - H * m
    b1, b2 = f2.cross(m), m.cross(f1)  # dA = b1 . df1 + b2 . df2
    stretch = ti.max((f1 - m.cross(f2)).norm(), LEAST_STRETCH)
    a, w = stretch - 2.0, H - 1.0
    d2 = ti.max(f1.norm_sqr() + f2.norm_sqr() - 2.0 * A, 0.0)
    on_a = (added[p, 0] * a + added[p, 1] * w) / stretch
    on_w = added[p, 1] * a + added[p, 2] * w
    kd, ks = added[p, 3], added[p, 4]
    tilt = (on_w - ks * H) / A  # weight of f3 . dm A = df1 . (f2 x s) + df2 . (s x f1)
    p1 = (on_a + kd) * f1 + (on_a - kd) * b1 + tilt * f2.cross(s)
    p2 = (on_a + kd) * f2 + (on_a - kd) * b2 + tilt * s.cross(f1)
    p3 = on_w * m + ks * s
    P = mat3([[p1[0], p2[0], p3[0]], [p1[1], p2[1], p3[1]], [p1[2], p2[2], p3[2]]]) @ T.transpose()
    plane = added[p, 0] * a**2 + 2.0 * added[p, 1] * a * w + added[p, 2] * w**2
    return P, plane + kd * d2 + ks * s.norm_sqr()


@ti.kernel
def add_layer_forces(
    cells: ti.types.ndarray(),
    cell_size: ti.types.ndarray(),
    cell_start: ti.types.ndarray(),
    xi: ti.types.ndarray(),
    V: ti.types.ndarray(),
    added: ti.types.ndarray(),
    frame: ti.types.ndarray(),
    F_in: ti.types.ndarray(),
    psi: ti.types.ndarray(),
    force: ti.types.ndarray(),
):
    """Adds energies to psi (p,) and forces to force (c, 8, 3) in the listed cells, whose particles' deformation is in
    F_in (p, 9)."""
    for k in range(cells.shape[0]):
        c = cells[k]
        h = vec3(cell_size[c, 0], cell_size[c, 1], cell_size[c, 2])
        total = ti.Matrix.zero(ti.f64, 8, 3)
        for p in range(cell_start[c], cell_start[c + 1]):
            P, energy = layer_law(load3(F_in, p), load3(frame, p), added, p)
            psi[p] += 0.5 * V[p] * energy
            total += shape_gradients(vec3(xi[p, 0], xi[p, 1], xi[p, 2]), h) @ (V[p] * P).transpose()
        for n in ti.static(range(8)):
            for i in ti.static(range(3)):
                force[c, n, i] -= total[n, i]


@ti.func
def in_layer(b: vec3, m: vec3, d: vec3, turn1: vec3, turn2: vec3):
    """Derivatives by f_1 and f_2 of the component of d along the direction b of the layer, in a frame that turns with
    it."""
    turned = b.dot(m.cross(d))
    return b - turned * turn1, b.cross(m) - turned * turn2


@ti.func
def layer_measures(f: mat3):
    """(a, w, d, s) with d and s along two directions that turn with the layer, and their derivatives by (f_1, f_2, f_3)
    as rows (6, 9)."""
    f1, f2, f3 = column(f, 0), column(f, 1), column(f, 2)
    m = f1.cross(f2)
    A = ti.max(m.norm(), LEAST_AREA)
    m /= A
    H = f3.dot(m)
    s = f3 - H * m
    dual1, dual2 = f2.cross(m) / A, m.cross(f1) / A
    e, d = f1 - m.cross(f2), f1 + m.cross(f2)
    stretch = ti.max(e.norm(), LEAST_STRETCH)
    x = e / stretch
    y = m.cross(x)
    turn1, turn2 = y / stretch, -x / stretch  # rotation of the layer in its plane by f_1 and f_2
    a1, a2 = (f1 + A * dual1) / stretch, (f2 + A * dual2) / stretch
    w1, w2 = f2.cross(s) / A, s.cross(f1) / A
    dx1, dx2 = in_layer(x, m, d, turn1, turn2)
    dy1, dy2 = in_layer(y, m, d, turn1, turn2)
    on_x, on_y = x.dot(m.cross(s)), y.dot(m.cross(s))
    sx1, sx2 = H * x.dot(dual1) * m - on_x * turn1, H * x.dot(dual2) * m - on_x * turn2
    sy1, sy2 = H * y.dot(dual1) * m - on_y * turn1, H * y.dot(dual2) * m - on_y * turn2
    value = vec6(stretch - 2.0, H - 1.0, d.dot(x), d.dot(y), s.dot(x), s.dot(y))
    rows = ti.Matrix.zero(ti.f64, 6, 9)
    for i in ti.static(range(3)):
        rows[0, i], rows[0, 3 + i] = a1[i], a2[i]
        rows[1, i], rows[1, 3 + i], rows[1, 6 + i] = w1[i], w2[i], m[i]
        rows[2, i], rows[2, 3 + i] = dx1[i], dx2[i]
        rows[3, i], rows[3, 3 + i] = dy1[i], dy2[i]
        rows[4, i], rows[4, 3 + i], rows[4, 6 + i] = sx1[i], sx2[i], x[i]
        rows[5, i], rows[5, 3 + i], rows[5, 6 + i] = sy1[i], sy2[i], y[i]
    return value, rows


@ti.func
def conjugate(added: ti.types.ndarray(), p: ti.i32, v: vec6) -> vec6:
    """Apply K_aa, K_aw, K_ww, k_d and k_s of a particle to its strain measures."""
    kd, ks = added[p, 3], added[p, 4]
    return vec6(added[p, 0] * v[0] + added[p, 1] * v[1], added[p, 1] * v[0] + added[p, 2] * v[1], kd * v[2], kd * v[3],
                ks * v[4], ks * v[5])  # fmt: skip


@ti.kernel
def start_layers(
    cells: ti.types.ndarray(),
    cell_start: ti.types.ndarray(),
    frame: ti.types.ndarray(),
    F_in: ti.types.ndarray(),
    out: ti.types.ndarray(),
):
    """Measures (p, 6) of the particles in the listed cells in a state."""
    for k in range(cells.shape[0]):
        c = cells[k]
        for p in range(cell_start[c], cell_start[c + 1]):
            value, _ = layer_measures(load3(F_in, p) @ load3(frame, p))
            for r in ti.static(range(6)):
                out[p, r] = value[r]


@ti.kernel
def add_layer_drag(
    rate: ti.f64,
    cells: ti.types.ndarray(),
    cell_size: ti.types.ndarray(),
    cell_start: ti.types.ndarray(),
    xi: ti.types.ndarray(),
    V: ti.types.ndarray(),
    added: ti.types.ndarray(),
    frame: ti.types.ndarray(),
    F_in: ti.types.ndarray(),
    before: ti.types.ndarray(),
    force: ti.types.ndarray(),
):
    """Material damping as in damping.py, rate = beta / dt: the gradient of the layers' energy for the change of their
    measures since `before` (p, 6), which a rigid motion does not change."""
    for k in range(cells.shape[0]):
        c = cells[k]
        h = vec3(cell_size[c, 0], cell_size[c, 1], cell_size[c, 2])
        total = ti.Matrix.zero(ti.f64, 8, 3)
        for p in range(cell_start[c], cell_start[c + 1]):
            T = load3(frame, p)
            value, rows = layer_measures(load3(F_in, p) @ T)
            for r in ti.static(range(6)):
                value[r] -= before[p, r]
            P = rows.transpose() @ conjugate(added, p, value)
            G = shape_gradients(vec3(xi[p, 0], xi[p, 1], xi[p, 2]), h) @ T
            for n in ti.static(range(8)):
                for i in ti.static(range(3)):
                    total[n, i] += V[p] * (G[n, 0] * P[i] + G[n, 1] * P[3 + i] + G[n, 2] * P[6 + i])
        for n in ti.static(range(8)):
            for i in ti.static(range(3)):
                force[c, n, i] -= rate * total[n, i]


@ti.kernel
def add_layer_tangents(
    cells: ti.types.ndarray(),
    cell_size: ti.types.ndarray(),
    cell_start: ti.types.ndarray(),
    xi: ti.types.ndarray(),
    V: ti.types.ndarray(),
    added: ti.types.ndarray(),
    frame: ti.types.ndarray(),
    F_in: ti.types.ndarray(),
    K: ti.types.ndarray(dtype=mat3f, ndim=3),
):
    """Adds the layers' tangents to the 8 x 8 blocks of the listed cells."""
    for k in range(cells.shape[0]):
        c = cells[k]
        h = vec3(cell_size[c, 0], cell_size[c, 1], cell_size[c, 2])
        for p in range(cell_start[c], cell_start[c + 1]):
            T = load3(frame, p)
            _, rows = layer_measures(load3(F_in, p) @ T)
            G = shape_gradients(vec3(xi[p, 0], xi[p, 1], xi[p, 2]), h) @ T
            for i in range(8):
                pushed = ti.Matrix.zero(ti.f64, 6, 3)
                for d in ti.static(range(3)):
                    value = vec6(0.0)
                    for r in ti.static(range(6)):
                        value[r] = G[i, 0] * rows[r, d] + G[i, 1] * rows[r, 3 + d] + G[i, 2] * rows[r, 6 + d]
                    value = V[p] * conjugate(added, p, value)
                    for r in ti.static(range(6)):
                        pushed[r, d] = value[r]
                for j in range(i + 1):
                    block = mat3(0.0)
                    for r in ti.static(range(6)):
                        for d in ti.static(range(3)):
                            moved = G[j, 0] * rows[r, d] + G[j, 1] * rows[r, 3 + d] + G[j, 2] * rows[r, 6 + d]
                            for b in ti.static(range(3)):
                                block[b, d] += pushed[r, b] * moved
                    K[c, i, j] = K[c, i, j] + ti.cast(block, ti.f32)
                    if j < i:
                        K[c, j, i] = K[c, i, j].transpose()
