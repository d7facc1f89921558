"""Transfers of the explicit material point method between particles and a uniform grid.

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

from solver.kernels.elastic import INVERTED, cofactor, mat3, rotation_by_newton, rotation_by_torque, vec3
from solver.kernels.mls_columns import (
    BLOCK_COLUMN,
    BLOCK_END,
    BLOCK_FIRST,
    DYNAMIC,
    GRAVITY_SHARE,
    MATERIAL_MASS,
    NODE_MASS,
    PARTICLE_MASS,
    PLATE_SPIN,
    PLATE_VELOCITY,
    SIDE_DISTANCE,
    SIDE_MARK,
    STATIC,
    VOLUME_LAMBDA,
    VOLUME_MU,
    vector_at,
)
from solver.kernels.mls_coupling import node_impulse
from solver.kernels.mls_moments import INVERSIONS, MOMENTS, SHARE, SQUARED_SPEED, STRAYS, moments

vec4 = ti.types.vector(4, ti.f64)

PENCIL = 4  # cells of a pencil along x and along y
SLACK = 1  # cells that a particle may be outside of it; 2 * SLACK + 2 <= PENCIL keeps pencils of one colour apart
TASK = 1024  # Taichi gives a thread no fewer iterations than this: a loop of TASK per pencil makes each its own task
POLAR_TOLERANCE = 2e-6  # squared change of the polar iteration: an error of 1e-6, and of the shear modulus


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
    return side[p, SIDE_MARK] > 0.0 and side[p, SIDE_MARK] == node_side[n, SIDE_MARK] and facing <= 0.0


@ti.func
def volume_times_stress(F: mat3, V_mu: ti.f64, V_lambda: ti.f64) -> mat3:
    """V P F^T = V (2 mu (F - R) F^T + lambda (J - 1) J I) of fixed-corotated material."""
    cof = cofactor(F)
    J = F[0, 0] * cof[0, 0] + F[1, 0] * cof[1, 0] + F[2, 0] * cof[2, 0]
    RF = (F - rotation_of(F, cof, J)) @ F.transpose()
    S = V_mu * (RF + RF.transpose())
    pressure = V_lambda * (J - 1.0) * J
    for d in ti.static(range(3)):
        S[d, d] += pressure
    return S


@ti.func
def add_to_nodes(
    thin: ti.template(), p: ti.i32, first: ti.i32, nodes_y: ti.i32, nodes_z: ti.i32, w: mat3, A: mat3, start: vec4,
    h: ti.f64, side: ti.template(), node_side: ti.template(), grid: ti.template(),
):  # fmt: skip
    """Add a particle's w_ip (momentum, mass) to its 27 nodes from `first` on; the momentum is `start` at that node and
    grows by A from node to node."""
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

    With `thin`, nothing is given to nodes behind a thin rigid body (CPIC [H18, Sec. 5.2]).
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
            m = known[PARTICLE_MASS]
            A = m * C[p]
            if known[VOLUME_MU] > 0.0:
                A -= (4.0 * dt / (h * h)) * volume_times_stress(F[p], known[VOLUME_MU], known[VOLUME_LAMBDA])
            base, w = spline(X, h, low)
            corner = low + h * ti.cast(base, ti.f64) - X
            momentum = m * (v[p] + dt * known[GRAVITY_SHARE] * g) + A @ corner
            start = vec4(momentum[0], momentum[1], momentum[2], m)
            first = (base[0] * nodes_y + base[1]) * nodes_z + base[2]
            add_to_nodes(thin, p, first, nodes_y, nodes_z, w, A, start, h, side, node_side, grid)


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
        m = grid[n, NODE_MASS]
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
                            m = constant[p, PARTICLE_MASS] * w[0, i] * w[1, j] * w[2, k]
                            if ti.static(thin):  # noqa: SIM102  decided when compiled
                                if apart(p, n, side, node_side):
                                    m = 0.0
                            arm = corner - h * vec3(i, j, k)
                            for d in ti.static(range(3)):
                                material[n, d] = material[n, d] + m * arm[d]
                            material[n, MATERIAL_MASS] = material[n, MATERIAL_MASS] + m


@ti.func
def impact(
    p: ti.i32, t: ti.i32, X: vec3, v: vec3, o: ti.i32, side: ti.template(), plate: ti.template(),
    plate_friction: ti.template(),
) -> vec3:  # fmt: skip
    """Change of velocity of a particle of soft body o that has entered thin body t: its own side of it stops it."""
    kick = vec3(0.0)
    if side[p, SIDE_DISTANCE] <= 0.0:
        spin = vector_at(plate, t, PLATE_SPIN)
        speed = vector_at(plate, t, PLATE_VELOCITY) + spin.cross(X - vector_at(plate, t, 0))
        mu_s, mu_d = plate_friction[t, o, STATIC], plate_friction[t, o, DYNAMIC]
        kick, _load, _share = node_impulse(v - speed, vector_at(side, p, 0), 1.0, mu_s, mu_d)
    return kick


@ti.func
def add_reaction(plate_impulse: ti.template(), b: ti.i32, t: ti.i32, arm: vec3, push: vec3):
    """Add an impulse on thin body t, with its moment about the centre, to the account of block b."""
    turn = arm.cross(push)
    for a in ti.static(range(3)):
        plate_impulse[b, 6 * t + a] = plate_impulse[b, 6 * t + a] + push[a]
        plate_impulse[b, 6 * t + 3 + a] = plate_impulse[b, 6 * t + 3 + a] + turn[a]


@ti.func
def nodal_sums(
    thin: ti.template(), p: ti.i32, first: ti.i32, nodes_y: ti.i32, nodes_z: ti.i32, w: mat3, ghost: vec3,
    side: ti.template(), node_side: ti.template(), grid: ti.template(),
):  # fmt: skip
    """Sums over the 27 nodes of a particle: of w v, of w v (i, j, k)^T with the node's index from 0 to 2 on each axis,
    and of w of the nodes behind a thin body, where v is `ghost`."""
    behind = 0.0
    V = vec3(0.0)
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
    return V, ti.Matrix.cols([Vi, Vj, Vk]), behind


@ti.func
def has_strayed(
    X: vec3, h: ti.f64, low: vec3, b: ti.i32, block: ti.template(), nodes_x: ti.i32, nodes_y: ti.i32, nodes_z: ti.i32
) -> ti.i32:
    """Whether a particle of block b is too far from its pencil or the grid; so is a position that is no number."""
    q = (X - low) * (1.0 / h) - 0.5
    inside = q[0] >= 0.0 and q[1] >= 0.0 and q[2] >= 0.0
    inside = inside and q[0] < nodes_x - 2 and q[1] < nodes_y - 2 and q[2] < nodes_z - 2
    for d in ti.static(range(2)):
        column = block[b, BLOCK_COLUMN + d]
        inside = inside and q[d] >= column - SLACK and q[d] < column + PENCIL + SLACK
    return not inside


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

    With `thin`, a node behind thin body t counts with the particle's own velocity after an impact on the body, and
    plate_impulse[b] takes what the body receives, six numbers per body about its centre.
    """
    for task in range(block.shape[0] * SHARE):
        if task % SHARE != 0:
            continue
        b = task // SHARE
        low = vec3(low_x, low_y, low_z)
        total = ti.Vector.zero(ti.f64, MOMENTS)
        fastest, strays, inverted = 0.0, 0.0, 0.0
        for p in range(block[b, BLOCK_FIRST], block[b, BLOCK_END]):
            X, m = x[p], constant[p][PARTICLE_MASS]
            base, w = spline(X, h, low)
            corner = low + h * ti.cast(base, ti.f64) - X
            first = (base[0] * nodes_y + base[1]) * nodes_z + base[2]
            t = -1  # the thin body that is near
            ghost, kick = vec3(0.0), vec3(0.0)
            if ti.static(thin):
                t = ti.cast(side[p, SIDE_MARK], ti.i32) - 1
                if t >= 0:
                    kick = impact(p, t, X, v[p], group[p] // 2, side, plate, plate_friction)
                ghost = v[p] + kick
            V, VI, behind = nodal_sums(thin, p, first, nodes_y, nodes_z, w, ghost, side, node_side, grid)
            B = (4.0 / (h * h)) * (V.outer_product(corner) + h * VI)
            if ti.static(thin):  # noqa: SIM102  decided when compiled
                if behind > 0.0:
                    add_reaction(plate_impulse, b, t, X - vector_at(plate, t, 0), (-m * behind) * kick)
            Fp = F[p]
            Fp += dt * (B @ Fp)
            X += dt * V
            x[p], v[p], C[p], F[p] = X, V, B, Fp
            total += moments(h, X, V, B, m)
            fastest = ti.max(fastest, V.norm_sqr())
            if has_strayed(X, h, low, b, block, nodes_x, nodes_y, nodes_z):
                strays += 1.0
            if Fp.determinant() <= 0.0:
                inverted += 1.0
        for s in ti.static(range(MOMENTS)):
            sums[b, s] = total[s]
        sums[b, SQUARED_SPEED], sums[b, STRAYS], sums[b, INVERSIONS] = fastest, strays, inverted
