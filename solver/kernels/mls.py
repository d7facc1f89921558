"""Transfers, grid coupling and rigid projection of the explicit material point method on a uniform grid.

Symbols: x, v, C, F per particle as in [J15] and [H18]; V rest volume, m mass; h cell size; node velocity and mass in
grid[n] = (v_x, v_y, v_z, m). Quadratic B-splines, so D = h^2 / 4 [J15].

    P2G  m_i v_i = sum_p w_ip [m_p v_p + (m_p C_p - dt V_p (4 / h^2) P_p F_p^T)(x_i - x_p)]     [H18]
    G2P  v_p = sum_i w_ip v_i,  C_p = (4 / h^2) sum_i w_ip v_i (x_i - x_p)^T,  F_p <- (I + dt C_p) F_p

Nothing is added atomically (Taichi's += on an array would be, so sums are written out): pencils of PENCIL x PENCIL
columns of cells are written in four colours, and a particle may be SLACK cells outside of its pencil before it must be
sorted again, so pencils of one colour never share a node.

[J15] Jiang, Schroeder, Selle, Teran, Stomakhin: The affine particle-in-cell method. SIGGRAPH 2015.
[H18] Hu, Fang, Ge, Qu, Zhu, Pradhana, Jiang: A moving least squares material point method with displacement
discontinuity and two-way rigid body coupling. SIGGRAPH 2018.
"""

import taichi as ti

from solver.kernels.elastic import INVERTED, cofactor, load3, mat3, rotation_by_newton, rotation_by_torque, vec3
from solver.kernels.query import FAR, LEAST_SLOPE, distance_at

vec4 = ti.types.vector(4, ti.f64)

PENCIL = 4  # cells of a pencil along x and along y
SLACK = 1  # cells that a particle may be outside of it; 2 * SLACK + 2 <= PENCIL keeps pencils of one colour apart
TASK = 1024  # Taichi gives a thread no fewer iterations than this: a loop of TASK per pencil makes each its own task
SHARE = 16  # the same for blocks, each its share of a task
POLAR_TOLERANCE = 2e-6  # squared change of the polar iteration: an error of 1e-6, and of the shear modulus
SUMS = 20  # of one block: m, m x (3), m v (3), angular momentum (3), m x x^T (6), energy, speed^2, strays, inverted
SWEEPS = 20  # of a coupling; the friction law converges in 3 to 6
SETTLED = 1e-12  # relative change of the rigid velocity at which a coupling's sweeps stop


@ti.func
def spline(x: vec3, h: ti.f64, low: vec3):
    """Base node and weights [3 axes, 3 nodes] of quadratic B-splines at x; low is the position of node (0, 0, 0)."""
    q = (x - low) * (1.0 / h)
    base = ti.Vector([ti.cast(ti.floor(q[d] - 0.5), ti.i32) for d in ti.static(range(3))])
    w = ti.Matrix.zero(ti.f64, 3, 3)
    for d in ti.static(range(3)):
        t = q[d] - base[d]
        w[d, 0], w[d, 1], w[d, 2] = 0.5 * (1.5 - t) ** 2, 0.75 - (t - 1.0) ** 2, 0.5 * (t - 0.5) ** 2
    return base, w


@ti.func
def rotation_of(F: mat3, C: mat3, J: ti.f64) -> mat3:
    """Polar rotation of F for either sign of J = det F; C is its cofactor matrix."""
    R = ti.Matrix.identity(ti.f64, 3)
    if J > INVERTED:  # noqa: SIM108  a kernel must not evaluate both
        R = rotation_by_newton(F, C, J, POLAR_TOLERANCE)
    else:
        R = rotation_by_torque(F, R)
    return R


@ti.func
def apart(p: ti.i32, n: ti.i32, side: ti.template(), node_side: ti.template()) -> ti.i32:
    """Whether a thin rigid body lies between a particle and a node: both are near it, on sides that face apart;
    a node midway between the two sides is on neither."""
    facing = side[p, 0] * node_side[n, 0] + side[p, 1] * node_side[n, 1] + side[p, 2] * node_side[n, 2]
    return side[p, 3] > 0.0 and side[p, 3] == node_side[n, 3] and facing <= 0.0


@ti.kernel
def particles_to_grid(
    thin: ti.template(),
    side: ti.types.ndarray(dtype=ti.f64, ndim=2),
    node_side: ti.types.ndarray(dtype=ti.f64, ndim=2),
    dt: ti.f64,
    h: ti.f64,
    low_x: ti.f64,
    low_y: ti.f64,
    low_z: ti.f64,
    nodes_y: ti.i32,
    nodes_z: ti.i32,
    pencils: ti.types.ndarray(dtype=ti.i32, ndim=1),
    pencil_start: ti.types.ndarray(dtype=ti.i32, ndim=1),
    x: ti.types.ndarray(dtype=vec3, ndim=1),
    v: ti.types.ndarray(dtype=vec3, ndim=1),
    C: ti.types.ndarray(dtype=mat3, ndim=1),
    F: ti.types.ndarray(dtype=mat3, ndim=1),
    constant: ti.types.ndarray(dtype=vec4, ndim=1),
    gravity: ti.types.ndarray(dtype=ti.f64, ndim=1),
    grid: ti.types.ndarray(dtype=vec4, ndim=1),
):
    """Add mass and momentum, elastic forces and gravity included, of the particles of pencils of one colour.

    constant[p] = (m, V mu, V lambda, share of gravity that acts). With `thin`, nothing is given to nodes behind a thin
    rigid body (CPIC [H18, Sec. 5.2]).
    """
    for task in range(pencils.shape[0] * TASK):
        if task % TASK != 0:
            continue
        q = task // TASK
        low = vec3(low_x, low_y, low_z)
        g = vec3(gravity[0], gravity[1], gravity[2])
        for p in range(pencil_start[pencils[q]], pencil_start[pencils[q] + 1]):
            X = x[p]
            known = constant[p]
            m = known[0]
            A = m * C[p]
            if known[1] > 0.0:
                Fp = F[p]
                cof = cofactor(Fp)
                J = Fp[0, 0] * cof[0, 0] + Fp[1, 0] * cof[1, 0] + Fp[2, 0] * cof[2, 0]
                RF = (Fp - rotation_of(Fp, cof, J)) @ Fp.transpose()
                S = known[1] * (RF + RF.transpose())
                pressure = known[2] * (J - 1.0) * J
                for d in ti.static(range(3)):
                    S[d, d] += pressure
                A -= (4.0 * dt / (h * h)) * S
            base, w = spline(X, h, low)
            corner = low + h * ti.cast(base, ti.f64) - X
            momentum = m * (v[p] + dt * known[3] * g) + A @ corner
            start = vec4(momentum[0], momentum[1], momentum[2], m)
            first = (base[0] * nodes_y + base[1]) * nodes_z + base[2]
            ax = vec4(A[0, 0], A[1, 0], A[2, 0], 0.0) * h
            ay = vec4(A[0, 1], A[1, 1], A[2, 1], 0.0) * h
            az = vec4(A[0, 2], A[1, 2], A[2, 2], 0.0) * h
            for i in ti.static(range(3)):
                for j in ti.static(range(3)):
                    row = start + i * ax + j * ay
                    share = w[0, i] * w[1, j]
                    n = first + (i * nodes_y + j) * nodes_z
                    for k in ti.static(range(3)):
                        weight = share * w[2, k]
                        if ti.static(thin):  # noqa: SIM102  decided when compiled
                            if apart(p, n + k, side, node_side):
                                weight = 0.0
                        grid[n + k] = grid[n + k] + weight * row
                        row += az


@ti.kernel
def clear(grid: ti.types.ndarray(dtype=ti.f64, ndim=2)):
    """Zero the grid."""
    for n in range(grid.shape[0]):
        for d in ti.static(range(4)):
            grid[n, d] = 0.0


@ti.kernel
def momentum_to_velocity(
    least_mass: ti.f64,
    held: ti.types.ndarray(dtype=ti.u8, ndim=1),
    grid: ti.types.ndarray(dtype=ti.f64, ndim=2),
):
    """Node velocities from momenta; held nodes stand still."""
    for n in range(grid.shape[0]):
        m = grid[n, 3]
        scale = 0.0
        if m > least_mass and held[n] == 0:
            scale = 1.0 / m
        for d in ti.static(range(3)):
            grid[n, d] *= scale


@ti.kernel
def material_at_nodes(
    thin: ti.template(),
    side: ti.types.ndarray(dtype=ti.f64, ndim=2),
    node_side: ti.types.ndarray(dtype=ti.f64, ndim=2),
    part: ti.i32,
    h: ti.f64,
    low_x: ti.f64,
    low_y: ti.f64,
    low_z: ti.f64,
    nodes_y: ti.i32,
    nodes_z: ti.i32,
    pencils: ti.types.ndarray(dtype=ti.i32, ndim=1),
    pencil_start: ti.types.ndarray(dtype=ti.i32, ndim=1),
    x: ti.types.ndarray(dtype=ti.f64, ndim=2),
    group: ti.types.ndarray(dtype=ti.i32, ndim=1),
    constant: ti.types.ndarray(dtype=ti.f64, ndim=2),
    material: ti.types.ndarray(dtype=ti.f64, ndim=2),
):
    """Mass, and mass times distance from the node, that one soft body (groups 2 part and 2 part + 1) brings to each
    node, for pencils of one colour; material[n] = (first moment (3), mass)."""
    for task in range(pencils.shape[0] * TASK):
        if task % TASK != 0:
            continue
        q = task // TASK
        low = vec3(low_x, low_y, low_z)
        for p in range(pencil_start[pencils[q]], pencil_start[pencils[q] + 1]):
            if group[p] // 2 == part:
                X = vec3(x[p, 0], x[p, 1], x[p, 2])
                base, w = spline(X, h, low)
                corner = X - low - h * ti.cast(base, ti.f64)
                first = (base[0] * nodes_y + base[1]) * nodes_z + base[2]
                for i in ti.static(range(3)):
                    for j in ti.static(range(3)):
                        for k in ti.static(range(3)):
                            n = first + (i * nodes_y + j) * nodes_z + k
                            m = constant[p, 0] * w[0, i] * w[1, j] * w[2, k]
                            if ti.static(thin):  # noqa: SIM102  decided when compiled
                                if apart(p, n, side, node_side):
                                    m = 0.0
                            material[n, 0] = material[n, 0] + m * (corner[0] - i * h)
                            material[n, 1] = material[n, 1] + m * (corner[1] - j * h)
                            material[n, 2] = material[n, 2] + m * (corner[2] - k * h)
                            material[n, 3] = material[n, 3] + m


@ti.func
def moments(h: ti.f64, X: vec3, V: vec3, B: mat3, m: ti.f64):
    """What one particle adds to the sums of its block but for the last three; its affine part counts in angular
    momentum and energy [J15]."""
    D = 0.25 * h * h
    L = m * (X.cross(V) + D * vec3(B[2, 1] - B[1, 2], B[0, 2] - B[2, 0], B[1, 0] - B[0, 1]))
    out = ti.Vector.zero(ti.f64, 17)
    out[0] = m
    for d in ti.static(range(3)):
        out[1 + d] = m * X[d]
        out[4 + d] = m * V[d]
        out[7 + d] = L[d]
        out[10 + d] = m * X[d] * X[d]
        out[13 + d] = m * X[(d + 1) % 3] * X[(d + 2) % 3]
    out[16] = 0.5 * m * (V.norm_sqr() + D * B.norm_sqr())
    return out


@ti.func
def node_impulse(u: vec3, n: vec3, m: ti.f64, mu_s: ti.f64, mu_d: ti.f64):
    """Impulse that a node with velocity u relative to the body takes, its normal part, and the share of its
    tangential motion that friction stops: sticking up to mu_s, else mu_d of the normal impulse."""
    impulse = vec3(0.0)
    normal_part = 0.0
    share = 0.0
    un = u.dot(n)
    if un < 0.0:
        normal_part = -m * un
        ut = u - un * n
        size = m * ut.norm()
        share = 1.0
        if size > mu_s * normal_part:
            share = mu_d * normal_part / size
        impulse = normal_part * n - (share * m) * ut
    return impulse, normal_part, share


@ti.kernel
def grid_to_particles(
    thin: ti.template(),
    side: ti.types.ndarray(dtype=ti.f64, ndim=2),
    node_side: ti.types.ndarray(dtype=ti.f64, ndim=2),
    group: ti.types.ndarray(dtype=ti.i32, ndim=1),
    plate: ti.types.ndarray(dtype=ti.f64, ndim=2),
    plate_friction: ti.types.ndarray(dtype=ti.f64, ndim=3),
    plate_impulse: ti.types.ndarray(dtype=ti.f64, ndim=2),
    dt: ti.f64,
    h: ti.f64,
    low_x: ti.f64,
    low_y: ti.f64,
    low_z: ti.f64,
    nodes_x: ti.i32,
    nodes_y: ti.i32,
    nodes_z: ti.i32,
    grid: ti.types.ndarray(dtype=vec4, ndim=1),
    block: ti.types.ndarray(dtype=ti.i32, ndim=2),
    x: ti.types.ndarray(dtype=vec3, ndim=1),
    v: ti.types.ndarray(dtype=vec3, ndim=1),
    C: ti.types.ndarray(dtype=mat3, ndim=1),
    F: ti.types.ndarray(dtype=mat3, ndim=1),
    constant: ti.types.ndarray(dtype=vec4, ndim=1),
    sums: ti.types.ndarray(dtype=ti.f64, ndim=2),
):
    """New velocities, affine matrices, positions and deformation; sums per block of particles.

    block[b] = (first particle, one past the last, first column of its pencil along x, along y). With `thin`, a node
    behind thin body t counts with the particle's own velocity after an impact on the body, plate[t] = (centre, V, w),
    and plate_impulse[b] takes what the body receives, six numbers per body about its centre.
    """
    for task in range(block.shape[0] * SHARE):
        if task % SHARE != 0:
            continue
        b = task // SHARE
        low = vec3(low_x, low_y, low_z)
        total = ti.Vector.zero(ti.f64, 17)
        fastest, strays, inverted = 0.0, 0.0, 0.0
        for p in range(block[b, 0], block[b, 1]):
            X = x[p]
            base, w = spline(X, h, low)
            corner = low + h * ti.cast(base, ti.f64) - X
            first = (base[0] * nodes_y + base[1]) * nodes_z + base[2]
            ghost = vec3(0.0)
            kick = vec3(0.0)
            if ti.static(thin):
                ghost = v[p]
                if side[p, 3] > 0.0:
                    t = ti.cast(side[p, 3], ti.i32) - 1
                    r = X - vec3(plate[t, 0], plate[t, 1], plate[t, 2])
                    speed = vec3(plate[t, 3], plate[t, 4], plate[t, 5])
                    speed += vec3(plate[t, 6], plate[t, 7], plate[t, 8]).cross(r)
                    o = group[p] // 2
                    n_ = vec3(side[p, 0], side[p, 1], side[p, 2])
                    if side[p, 4] <= 0.0:  # it is inside: its own side of the body stops it
                        kick, _l, _s = node_impulse(
                            ghost - speed, n_, 1.0, plate_friction[t, o, 0], plate_friction[t, o, 1]
                        )
                    ghost += kick
            behind = 0.0
            V = vec3(0.0)  # sums over nodes of w v, and of w v times the node's index i, j, k
            Vi, Vj, Vk = vec3(0.0), vec3(0.0), vec3(0.0)
            for i in ti.static(range(3)):
                slice_v, slice_j, slice_k = vec3(0.0), vec3(0.0), vec3(0.0)
                for j in ti.static(range(3)):
                    n = first + (i * nodes_y + j) * nodes_z
                    row, row_k = vec3(0.0), vec3(0.0)
                    for k in ti.static(range(3)):
                        node = grid[n + k]
                        one = w[2, k] * vec3(node[0], node[1], node[2])
                        if ti.static(thin):  # noqa: SIM102  decided when compiled
                            if apart(p, n + k, side, node_side):
                                one = w[2, k] * ghost
                                behind += w[0, i] * w[1, j] * w[2, k]
                        row += one
                        if ti.static(k > 0):
                            row_k += k * one
                    row *= w[1, j]
                    slice_v += row
                    slice_k += w[1, j] * row_k
                    if ti.static(j > 0):
                        slice_j += j * row
                slice_v *= w[0, i]
                V += slice_v
                Vj += w[0, i] * slice_j
                Vk += w[0, i] * slice_k
                if ti.static(i > 0):
                    Vi += i * slice_v
            B = mat3(0.0)
            for d in ti.static(range(3)):
                B[d, 0] = corner[0] * V[d] + h * Vi[d]
                B[d, 1] = corner[1] * V[d] + h * Vj[d]
                B[d, 2] = corner[2] * V[d] + h * Vk[d]
            B *= 4.0 / (h * h)
            if ti.static(thin):  # noqa: SIM102  decided when compiled
                if behind > 0.0:
                    t = ti.cast(side[p, 3], ti.i32) - 1
                    r = X - vec3(plate[t, 0], plate[t, 1], plate[t, 2])
                    push = (-constant[p][0] * behind) * kick
                    turn = r.cross(push)
                    for a in ti.static(range(3)):
                        plate_impulse[b, 6 * t + a] = plate_impulse[b, 6 * t + a] + push[a]
                        plate_impulse[b, 6 * t + 3 + a] = plate_impulse[b, 6 * t + 3 + a] + turn[a]
            Fp = F[p]
            Fp += dt * (B @ Fp)
            X += dt * V
            x[p], v[p], C[p], F[p] = X, V, B, Fp
            total += moments(h, X, V, B, constant[p][0])
            fastest = ti.max(fastest, V.norm_sqr())
            q = (X - low) * (1.0 / h) - 0.5
            inside = q[0] >= block[b, 2] - SLACK and q[0] < block[b, 2] + PENCIL + SLACK
            inside = inside and q[1] >= block[b, 3] - SLACK and q[1] < block[b, 3] + PENCIL + SLACK
            inside = inside and q[0] >= 0.0 and q[1] >= 0.0 and q[2] >= 0.0
            inside = inside and q[0] < nodes_x - 2 and q[1] < nodes_y - 2 and q[2] < nodes_z - 2
            if not inside:  # true for a position that is not a number too
                strays += 1.0
            if Fp.determinant() <= 0.0:
                inverted += 1.0
        for s in ti.static(range(17)):
            sums[b, s] = total[s]
        sums[b, 17], sums[b, 18], sums[b, 19] = fastest, strays, inverted


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
            total = ti.Vector.zero(ti.f64, 17)
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
            for s in ti.static(range(17)):
                sums[b, s] = total[s]
            sums[b, 17] = fastest


@ti.func
def distance_and_normal(x: vec3, frame: ti.template(), spacing: ti.f64, values: ti.template()):
    """Signed distance of a rigid body at a world point and its outward normal, zero midway between two surfaces; frame
    as in distance_at_nodes."""
    Q = mat3(0.0)
    c, c0, o = vec3(0.0), vec3(0.0), vec3(0.0)
    for i in ti.static(range(3)):
        c[i], c0[i], o[i] = frame[1, i], frame[2, i], frame[3, i]
        for j in ti.static(range(3)):
            Q[i, j] = frame[4 + i, j]
    X = Q.transpose() @ (x - c) + c0
    inner = X
    for a in ti.static(range(3)):  # samples end a little outside of the body; go on linearly from their edge
        inner[a] = ti.math.clamp(X[a], o[a] + 0.6 * spacing, o[a] + (values.shape[a] - 1.6) * spacing)
    phi, N = distance_at(inner, o, spacing, values)
    n = vec3(0.0)
    if phi < FAR and N.norm() > LEAST_SLOPE:
        phi += N.dot(X - inner)
        n = (Q @ N).normalized()
    return phi, n


@ti.kernel
def distance_at_nodes(
    h: ti.f64,
    nodes_y: ti.i32,
    nodes_z: ti.i32,
    frame: ti.types.ndarray(dtype=ti.f64, ndim=2),
    span: ti.types.ndarray(dtype=ti.i32, ndim=2),
    least_mass: ti.f64,
    held: ti.types.ndarray(dtype=ti.u8, ndim=1),
    grid: ti.types.ndarray(dtype=ti.f64, ndim=2),
    spacing: ti.f64,
    values: ti.types.ndarray(dtype=ti.f32, ndim=3),
    phi: ti.types.ndarray(dtype=ti.f64, ndim=1),
    normal: ti.types.ndarray(dtype=ti.f64, ndim=2),
):
    """Signed distance and outward normal of a rigid body at the nodes of span = (first, count) that hold more than
    least_mass and are not held.

    frame = position of node (0, 0, 0), centre, start centre, sample origin, then the rotation's three rows.
    """
    low = vec3(frame[0, 0], frame[0, 1], frame[0, 2])
    for s in range(span[1, 0] * span[1, 1] * span[1, 2]):
        i = span[0, 0] + s // (span[1, 1] * span[1, 2])
        j = span[0, 1] + (s // span[1, 2]) % span[1, 1]
        k = span[0, 2] + s % span[1, 2]
        phi[s] = FAR
        node = (i * nodes_y + j) * nodes_z + k
        if grid[node, 3] > least_mass and held[node] == 0:
            d, n = distance_and_normal(low + h * vec3(i, j, k), frame, spacing, values)
            if n.norm_sqr() > 0.0:
                phi[s] = d
            for a in ti.static(range(3)):
                normal[s, a] = n[a]


@ti.func
def solve6(K: ti.template(), q: ti.template()):
    """Solve the symmetric positive system K[:, :6] q = K[:, 6] by elimination; K is destroyed."""
    for a in range(6):
        for r in range(a + 1, 6):
            f = K[r, a] / K[a, a]
            for s in range(a, 7):
                K[r, s] -= f * K[a, s]
    for back in range(6):
        a = 5 - back
        value = K[a, 6]
        for s in range(a + 1, 6):
            value -= K[a, s] * q[s]
        q[a] = value / K[a, a]


@ti.func
def touching_centroid(t: ti.f64) -> ti.f64:
    """Where a node at 0 sees the centroid of a half-space of material that begins at t (both in cells): the first
    moment of the quadratic B-spline beyond t over its mass there."""
    out = 0.0
    if t >= 0.5:
        out = 1.5 - 0.75 * (1.5 - t)
    elif t > -0.5:
        out = (0.203125 - 0.375 * t * t + 0.25 * t**4) / (0.5 - 0.75 * t + t**3 / 3.0)
    elif t > -1.5:
        u = 1.5 + t
        out = (0.25 * u**3 - 0.125 * u**4) / (1.0 - u**3 / 6.0)
    return out


@ti.kernel
def couple(
    free: ti.i32,
    h: ti.f64,
    reach: ti.f64,
    least_mass: ti.f64,
    nodes_y: ti.i32,
    nodes_z: ti.i32,
    frame: ti.types.ndarray(dtype=ti.f64, ndim=2),
    span: ti.types.ndarray(dtype=ti.i32, ndim=2),
    phi: ti.types.ndarray(dtype=ti.f64, ndim=1),
    normal: ti.types.ndarray(dtype=ti.f64, ndim=2),
    owner: ti.types.ndarray(dtype=ti.i32, ndim=1),
    material: ti.types.ndarray(dtype=ti.f64, ndim=2),
    friction: ti.types.ndarray(dtype=ti.f64, ndim=2),
    mass: ti.types.ndarray(dtype=ti.f64, ndim=2),
    grid: ti.types.ndarray(dtype=ti.f64, ndim=2),
    q: ti.types.ndarray(dtype=ti.f64, ndim=1),
    K: ti.types.ndarray(dtype=ti.f64, ndim=2),
    active: ti.types.ndarray(dtype=ti.i32, ndim=2),
    out: ti.types.ndarray(dtype=ti.f64, ndim=2),
):
    """Let a rigid body and the nodes within `reach` of its inside exchange impulses; its velocity q = (V, w) is taken
    at the end of the exchange, so light bodies on heavy material are stable.

    out[s] per owner s: normal impulse (1), impulse on the material (3), its moment about the centre (3), loaded
    points' n n^T weights G^T n n^T G (36, weighted by normal impulse), first moment of the points (3), normal
    impulse vector (3).
    """
    ti.loop_config(serialize=True)
    for _ in range(1):
        low = vec3(frame[0, 0], frame[0, 1], frame[0, 2])
        c = vec3(frame[1, 0], frame[1, 1], frame[1, 2])
        count = 0
        for s in range(span[1, 0] * span[1, 1] * span[1, 2]):
            if phi[s] <= reach:
                i = span[0, 0] + s // (span[1, 1] * span[1, 2])
                j = span[0, 1] + (s // span[1, 2]) % span[1, 1]
                k = span[0, 2] + s % span[1, 2]
                node = (i * nodes_y + j) * nodes_z + k
                there = material[node, 3]
                offset = FAR
                if grid[node, 3] > least_mass and there > 0.0:
                    offset = 0.0
                    for a in ti.static(range(3)):
                        offset += material[node, a] / there * normal[s, a]
                if offset <= h * touching_centroid(-phi[s] / h):
                    active[count, 0] = s
                    active[count, 1] = node
                    count += 1
        q0 = ti.Vector.zero(ti.f64, 6)
        for a in ti.static(range(6)):
            q0[a] = q[a]
        sweep = 0
        moving = free == 1 and count > 0
        while moving and sweep < SWEEPS:
            sweep += 1
            for a in range(6):
                for d in range(6):
                    K[a, d] = mass[a, d]
                K[a, 6] = 0.0
                for d in range(6):
                    K[a, 6] += mass[a, d] * q0[d]
            V = vec3(q[0], q[1], q[2])
            w = vec3(q[3], q[4], q[5])
            for t in range(count):
                s, n_ = active[t, 0], active[t, 1]
                n = vec3(normal[s, 0], normal[s, 1], normal[s, 2])
                r = low - c + h * vec3(n_ // (nodes_y * nodes_z), (n_ // nodes_z) % nodes_y, n_ % nodes_z)
                m = grid[n_, 3]
                v = vec3(grid[n_, 0], grid[n_, 1], grid[n_, 2])
                o = owner[n_]
                _i, load, share = node_impulse(v - V - w.cross(r), n, m, friction[o, 0], friction[o, 1])
                if load > 0.0:
                    A = m * (share * ti.Matrix.identity(ti.f64, 3) + (1.0 - share) * n.outer_product(n))
                    X = mat3([[0.0, -r[2], r[1]], [r[2], 0.0, -r[0]], [-r[1], r[0], 0.0]])
                    XA = X @ A
                    XAX = XA @ X.transpose()
                    f = A @ v
                    moment = r.cross(f)
                    for a in ti.static(range(3)):
                        K[a, 6] += f[a]
                        K[3 + a, 6] += moment[a]
                        for d in ti.static(range(3)):
                            K[a, d] += A[a, d]
                            K[3 + a, d] += XA[a, d]
                            K[d, 3 + a] += XA[a, d]
                            K[3 + a, 3 + d] += XAX[a, d]
            change = 0.0
            size = 0.0
            before = ti.Vector.zero(ti.f64, 6)
            for a in ti.static(range(6)):
                before[a] = q[a]
            solve6(K, q)
            for a in ti.static(range(6)):
                change += (q[a] - before[a]) ** 2
                size += q[a] ** 2
            moving = change > SETTLED**2 * size
        V = vec3(q[0], q[1], q[2])
        w = vec3(q[3], q[4], q[5])
        total = vec3(0.0)
        turn = vec3(0.0)
        for t in range(count):
            s, n_ = active[t, 0], active[t, 1]
            n = vec3(normal[s, 0], normal[s, 1], normal[s, 2])
            r = low - c + h * vec3(n_ // (nodes_y * nodes_z), (n_ // nodes_z) % nodes_y, n_ % nodes_z)
            m = grid[n_, 3]
            v = vec3(grid[n_, 0], grid[n_, 1], grid[n_, 2])
            o = owner[n_]
            impulse, load, _s = node_impulse(v - V - w.cross(r), n, m, friction[o, 0], friction[o, 1])
            if load > 0.0:
                total += impulse
                moment = r.cross(impulse)
                turn += moment
                rn = r.cross(n)
                out[o, 0] += load
                for a in ti.static(range(3)):
                    grid[n_, a] = grid[n_, a] + impulse[a] / m
                    out[o, 1 + a] += impulse[a]
                    out[o, 4 + a] += moment[a]
                    out[o, 43 + a] += load * r[a]
                    out[o, 46 + a] += load * n[a]
                    for d in ti.static(range(3)):
                        out[o, 7 + 6 * a + d] += load * n[a] * n[d]
                        out[o, 7 + 6 * a + 3 + d] += load * n[a] * rn[d]
                        out[o, 7 + 6 * (3 + a) + d] += load * rn[a] * n[d]
                        out[o, 7 + 6 * (3 + a) + 3 + d] += load * rn[a] * rn[d]
        if free == 1 and count > 0:
            for a in range(6):
                for d in range(6):
                    K[a, d] = mass[a, d]
                K[a, 6] = -total[a] if a < 3 else -turn[a - 3]
            solve6(K, q)
            for a in ti.static(range(6)):
                q[a] += q0[a]


@ti.kernel
def sides_at_nodes(
    mark: ti.f64,
    h: ti.f64,
    nodes_y: ti.i32,
    nodes_z: ti.i32,
    reach: ti.f64,
    frame: ti.types.ndarray(dtype=ti.f64, ndim=2),
    span: ti.types.ndarray(dtype=ti.i32, ndim=2),
    spacing: ti.f64,
    values: ti.types.ndarray(dtype=ti.f32, ndim=3),
    node_side: ti.types.ndarray(dtype=ti.f64, ndim=2),
):
    """Which side of a thin rigid body each node within `reach` of it is on: (normal (3), mark)."""
    for s in range(span[1, 0] * span[1, 1] * span[1, 2]):
        i = span[0, 0] + s // (span[1, 1] * span[1, 2])
        j = span[0, 1] + (s // span[1, 2]) % span[1, 1]
        k = span[0, 2] + s % span[1, 2]
        x = vec3(frame[0, 0], frame[0, 1], frame[0, 2]) + h * vec3(i, j, k)
        phi, n = distance_and_normal(x, frame, spacing, values)
        if phi < reach:
            node = (i * nodes_y + j) * nodes_z + k
            for a in ti.static(range(3)):
                node_side[node, a] = n[a]
            node_side[node, 3] = mark


@ti.kernel
def sides_of_particles(
    mark: ti.f64,
    reach: ti.f64,
    frame: ti.types.ndarray(dtype=ti.f64, ndim=2),
    spacing: ti.f64,
    values: ti.types.ndarray(dtype=ti.f32, ndim=3),
    x: ti.types.ndarray(dtype=ti.f64, ndim=2),
    side: ti.types.ndarray(dtype=ti.f64, ndim=2),
):
    """The same for particles, with their distance: (normal (3), mark, phi); one that was near before stays on its side,
    also where it has been pressed through."""
    for p in range(x.shape[0]):
        phi, n = distance_and_normal(vec3(x[p, 0], x[p, 1], x[p, 2]), frame, spacing, values)
        if phi < reach and n.norm_sqr() > 0.0:
            before = vec3(side[p, 0], side[p, 1], side[p, 2])
            if side[p, 3] == mark and before.dot(n) < 0.0:
                n = -n
                phi = -ti.abs(phi)
            for a in ti.static(range(3)):
                side[p, a] = n[a]
            side[p, 3] = mark
            side[p, 4] = phi
        elif phi >= reach and side[p, 3] == mark:
            side[p, 3] = 0.0
