"""Transfers of the explicit material point method between the particles of one body and a graded grid around it.

Symbols: x, u, C, F per particle as in [J15] and [H18]; V rest volume, m mass. The grid is fixed in a frame that moves
with the body, X = R^T (x - c) + c0, so a body that falls or rolls does not cross it. Node planes along each of its axes
may be any increasing list; weights are quadratic B-splines in the plane index, interpolated linearly between two
planes. On graded planes the weights of a particle have a middle different from its position, and their own spread along
each axis a:

    Xm = sum_i w_i X_i ,  D_a = sum_i w_i (X_i - Xm)_a^2              (equal planes h apart: Xm = X, D = h^2 / 4)

u is the velocity at the middle. With moving least squares about it [H18] linear fields are exact on any planes:

    P2G  m_i v_i = sum_p w_ip [m_p u_p + (m_p C_p - dt V_p P_p F_p^T D^-1)(x_i - xm_p)]
    G2P  u_p = sum_i w_ip v_i,  C_p = sum_i w_ip v_i (x_i - xm_p)^T D^-1,  F_p <- (I + dt C_p) F_p

Nothing is added atomically: pencils of PENCIL x PENCIL columns of cells are written in four colours, and a particle may
leave its pencil by SLACK cells before it must be sorted again, so pencils of one colour never share a node.

[J15] Jiang, Schroeder, Selle, Teran, Stomakhin: The affine particle-in-cell method. SIGGRAPH 2015.
[H18] Hu, Fang, Ge, Qu, Zhu, Pradhana, Jiang: A moving least squares material point method with displacement
discontinuity and two-way rigid body coupling. SIGGRAPH 2018.
"""

import taichi as ti

from solver.kernels.elastic import INVERTED, cofactor, load3, mat3, rotation_by_newton, rotation_by_torque, vec3
from solver.kernels.layers import column, layer_law
from solver.kernels.query import plane_interval

vec4 = ti.types.vector(4, ti.f64)

PENCIL = 4  # cells of a pencil along x and along y
SLACK = 1  # cells by which a particle may leave it; 2 * SLACK + 2 <= PENCIL keeps pencils of one colour apart
TASK = 1024  # Taichi gives a thread at least this many iterations: a loop of TASK per pencil makes each pencil a task
SHARE = 16  # number of blocks per task
POLAR_TOLERANCE = 2e-6  # squared change of the polar iteration: an error of 1e-6, also in the shear modulus

# columns of a particle's constants
PARTICLE_MASS = 0  # [kg]
VOLUME_MU = 1  # rest volume times shear modulus [J]
VOLUME_LAMBDA = 2  # rest volume times first Lame parameter [J]
GRAVITY_SHARE = 3  # share of gravity that acts on it [-]
VOLUME = 4  # [m^3]

# rows of a frame
CENTER = 0  # c [m]
START_CENTER = 1  # c0 [m]
ROTATION = 2  # R, three rows

# columns of the sums of one block of particles; for vectors and m x x^T the first column
MASS = 0  # m
FIRST_MOMENT = 1  # m xm, 3 columns
MOMENTUM = 4  # m u, 3 columns
ANGULAR_MOMENTUM = 7  # about the origin, 3 columns
SECOND_MOMENT = 10  # m (xm xm^T + D): xx, yy, zz, yz, zx, xy
ENERGY = 16  # kinetic
MOMENTS = 17  # number of columns that are sums over particles; they are followed by
SQUARED_SPEED = 17  # of the fastest particle
STRAYS = 18  # particles that have left their pencil
INVERSIONS = 19  # particles with det F <= 0
SUMS = 20  # columns in all


@ti.func
def frame_row(frame: ti.template(), row: ti.template()) -> vec3:
    """A vector of a frame."""
    return vec3(frame[row, 0], frame[row, 1], frame[row, 2])


@ti.func
def frame_rotation(frame: ti.template()) -> mat3:
    """R of a frame."""
    return ti.Matrix.rows([frame_row(frame, ROTATION + i) for i in ti.static(range(3))])


@ti.func
def along(planes: ti.template(), X: ti.f64):
    """For three nodes around X on an axis: index of the first, weights, and places relative to the middle of the
    weights; that middle; the spread; and the interpolated plane index of X."""
    k = plane_interval(planes, X)
    q = k + (X - planes[k]) / (planes[k + 1] - planes[k])
    base = ti.math.clamp(ti.cast(ti.floor(q - 0.5), ti.i32), 0, planes.shape[0] - 3)
    t = q - base
    w = vec3(0.5 * (1.5 - t) ** 2, 0.75 - (t - 1.0) ** 2, 0.5 * (t - 0.5) ** 2)
    place = vec3(planes[base], planes[base + 1], planes[base + 2])
    middle = w.dot(place)
    arm = place - middle
    return base, w, arm, middle, w.dot(arm * arm), q


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


@ti.kernel
def particles_to_grid(
    layered: ti.template(),
    dt: ti.f64,
    frame: ti.types.ndarray(dtype=ti.f64, ndim=2),
    planes_x: ti.types.ndarray(dtype=ti.f64, ndim=1),
    planes_y: ti.types.ndarray(dtype=ti.f64, ndim=1),
    planes_z: ti.types.ndarray(dtype=ti.f64, ndim=1),
    pencils: ti.types.ndarray(dtype=ti.i32, ndim=1),
    pencil_start: ti.types.ndarray(dtype=ti.i32, ndim=1),
    x: ti.types.ndarray(dtype=vec3, ndim=1),
    u: ti.types.ndarray(dtype=vec3, ndim=1),
    C: ti.types.ndarray(dtype=mat3, ndim=1),
    F: ti.types.ndarray(dtype=mat3, ndim=1),
    constant: ti.types.ndarray(dtype=ti.f64, ndim=2),
    added: ti.types.ndarray(dtype=ti.f64, ndim=2),
    layers: ti.types.ndarray(dtype=ti.f64, ndim=2),
    gravity: ti.types.ndarray(dtype=ti.f64, ndim=1),
    grid: ti.types.ndarray(dtype=vec4, ndim=1),
):
    """Add mass and momentum, including elastic forces and gravity, of the particles in pencils of one colour."""
    for task in range(pencils.shape[0] * TASK):
        if task % TASK != 0:
            continue
        q = task // TASK
        R, c, c0 = frame_rotation(frame), frame_row(frame, CENTER), frame_row(frame, START_CENTER)
        g = vec3(gravity[0], gravity[1], gravity[2])
        nodes_y, nodes_z = planes_y.shape[0], planes_z.shape[0]
        for p in range(pencil_start[pencils[q]], pencil_start[pencils[q] + 1]):
            X = R.transpose() @ (x[p] - c) + c0
            i0, wx, ax, _mx, Dx, _qx = along(planes_x, X[0])
            j0, wy, ay, _my, Dy, _qy = along(planes_y, X[1])
            k0, wz, az, _mz, Dz, _qz = along(planes_z, X[2])
            m = constant[p, PARTICLE_MASS]
            A = m * (C[p] @ R)
            if constant[p, VOLUME_MU] > 0.0:
                S = volume_times_stress(F[p], constant[p, VOLUME_MU], constant[p, VOLUME_LAMBDA])
                if ti.static(layered):
                    P, _energy = layer_law(F[p], load3(layers, p), added, p)
                    S += constant[p, VOLUME] * (P @ F[p].transpose())
                B = S @ R
                for d in ti.static(range(3)):
                    A[d, 0] -= dt / Dx * B[d, 0]
                    A[d, 1] -= dt / Dy * B[d, 1]
                    A[d, 2] -= dt / Dz * B[d, 2]
            start = m * (u[p] + dt * constant[p, GRAVITY_SHARE] * g)
            a0, a1, a2 = column(A, 0), column(A, 1), column(A, 2)
            for i in ti.static(range(3)):
                plane = start + ax[i] * a0
                for j in ti.static(range(3)):
                    row = plane + ay[j] * a1
                    share = wx[i] * wy[j]
                    n = ((i0 + i) * nodes_y + j0 + j) * nodes_z + k0
                    for k in ti.static(range(3)):
                        here = row + az[k] * a2
                        grid[n + k] += share * wz[k] * vec4(here[0], here[1], here[2], m)


@ti.kernel
def clear(grid: ti.types.ndarray(dtype=vec4, ndim=1)):
    """Zero the grid."""
    for n in range(grid.shape[0]):
        grid[n] = vec4(0.0)


@ti.kernel
def momentum_to_velocity(
    least_mass: ti.f64,
    held: ti.types.ndarray(dtype=ti.u8, ndim=1),
    grid: ti.types.ndarray(dtype=vec4, ndim=1),
):
    """Node velocities from momenta; held nodes do not move."""
    for n in range(grid.shape[0]):
        node = grid[n]
        scale = 0.0
        if node[3] > least_mass and held[n] == 0:
            scale = 1.0 / node[3]
        grid[n] = scale * node


@ti.func
def moments(x: vec3, u: vec3, C: mat3, D: mat3, m: ti.f64):
    """Contribution of one particle to the first MOMENTS sums of its block: a small body with second moment m D about
    its middle x, with velocity u there and velocity gradient C."""
    B = C @ D
    L = m * (x.cross(u) + vec3(B[2, 1] - B[1, 2], B[0, 2] - B[2, 0], B[1, 0] - B[0, 1]))
    out = ti.Vector.zero(ti.f64, MOMENTS)
    out[MASS] = m
    for d in ti.static(range(3)):
        out[FIRST_MOMENT + d] = m * x[d]
        out[MOMENTUM + d] = m * u[d]
        out[ANGULAR_MOMENTUM + d] = L[d]
        out[SECOND_MOMENT + d] = m * (x[d] * x[d] + D[d, d])
        e, f = (d + 1) % 3, (d + 2) % 3
        out[SECOND_MOMENT + 3 + d] = m * (x[e] * x[f] + D[e, f])
    work = B @ C.transpose()
    out[ENERGY] = 0.5 * m * (u.norm_sqr() + work[0, 0] + work[1, 1] + work[2, 2])
    return out


@ti.func
def spread(R: mat3, Dx: ti.f64, Dy: ti.f64, Dz: ti.f64) -> mat3:
    """R diag(D) R^T."""
    return R @ mat3([[Dx, 0.0, 0.0], [0.0, Dy, 0.0], [0.0, 0.0, Dz]]) @ R.transpose()


@ti.kernel
def grid_to_particles(
    dt: ti.f64,
    frame: ti.types.ndarray(dtype=ti.f64, ndim=2),
    planes_x: ti.types.ndarray(dtype=ti.f64, ndim=1),
    planes_y: ti.types.ndarray(dtype=ti.f64, ndim=1),
    planes_z: ti.types.ndarray(dtype=ti.f64, ndim=1),
    grid: ti.types.ndarray(dtype=vec4, ndim=1),
    block: ti.types.ndarray(dtype=ti.i32, ndim=2),
    x: ti.types.ndarray(dtype=vec3, ndim=1),
    u: ti.types.ndarray(dtype=vec3, ndim=1),
    C: ti.types.ndarray(dtype=mat3, ndim=1),
    F: ti.types.ndarray(dtype=mat3, ndim=1),
    constant: ti.types.ndarray(dtype=ti.f64, ndim=2),
    sums: ti.types.ndarray(dtype=ti.f64, ndim=2),
):
    """New velocities, affine matrices, positions and deformation; sums per block of particles.

    block[b] = first particle, one past the last, first column of cells of its pencil along x and along y.
    """
    for task in range(block.shape[0] * SHARE):
        if task % SHARE != 0:
            continue
        b = task // SHARE
        R, c, c0 = frame_rotation(frame), frame_row(frame, CENTER), frame_row(frame, START_CENTER)
        nodes_y, nodes_z = planes_y.shape[0], planes_z.shape[0]
        total = ti.Vector.zero(ti.f64, MOMENTS)
        fastest, strays, inverted = 0.0, 0.0, 0.0
        for p in range(block[b, 0], block[b, 1]):
            X, m = R.transpose() @ (x[p] - c) + c0, constant[p, PARTICLE_MASS]
            i0, wx, ax, mx, Dx, qx = along(planes_x, X[0])
            j0, wy, ay, my, Dy, qy = along(planes_y, X[1])
            k0, wz, az, mz, Dz, qz = along(planes_z, X[2])
            V, Vx, Vy, Vz = vec3(0.0), vec3(0.0), vec3(0.0), vec3(0.0)
            for i in ti.static(range(3)):
                slice_v, slice_y, slice_z = vec3(0.0), vec3(0.0), vec3(0.0)
                for j in ti.static(range(3)):
                    n = ((i0 + i) * nodes_y + j0 + j) * nodes_z + k0
                    row, row_z = vec3(0.0), vec3(0.0)
                    for k in ti.static(range(3)):
                        node = grid[n + k]
                        one = wz[k] * vec3(node[0], node[1], node[2])
                        row += one
                        row_z += az[k] * one
                    slice_v += wy[j] * row
                    slice_y += wy[j] * ay[j] * row
                    slice_z += wy[j] * row_z
                V += wx[i] * slice_v
                Vx += wx[i] * ax[i] * slice_v
                Vy += wx[i] * slice_y
                Vz += wx[i] * slice_z
            B = ti.Matrix.cols([Vx / Dx, Vy / Dy, Vz / Dz])
            shift = vec3(mx - X[0], my - X[1], mz - X[2])
            velocity = V - B @ shift
            G = B @ R.transpose()
            Fp = F[p]
            Fp += dt * (G @ Fp)
            here = x[p] + dt * velocity
            x[p], u[p], C[p], F[p] = here, V, G, Fp
            total += moments(here + R @ shift, V, G, spread(R, Dx, Dy, Dz), m)
            fastest = ti.max(fastest, V.norm_sqr())
            cell = vec3(qx - 0.5, qy - 0.5, qz - 0.5)
            stays = cell[0] >= 1.0 and cell[1] >= 1.0 and cell[2] >= 1.0  # False for a position that is NaN
            stays = stays and cell[0] < planes_x.shape[0] - 3 and cell[1] < nodes_y - 3 and cell[2] < nodes_z - 3
            for d in ti.static(range(2)):
                first = block[b, 2 + d]
                stays = stays and cell[d] >= first - SLACK and cell[d] < first + PENCIL + SLACK
            if not stays:
                strays += 1.0
            if Fp.determinant() <= 0.0:
                inverted += 1.0
        for s in ti.static(range(MOMENTS)):
            sums[b, s] = total[s]
        sums[b, SQUARED_SPEED], sums[b, STRAYS], sums[b, INVERSIONS] = fastest, strays, inverted


@ti.kernel
def move_group(
    group: ti.i32,
    keep: ti.f64,
    motion: ti.types.ndarray(dtype=ti.f64, ndim=2),
    frame: ti.types.ndarray(dtype=ti.f64, ndim=2),
    planes_x: ti.types.ndarray(dtype=ti.f64, ndim=1),
    planes_y: ti.types.ndarray(dtype=ti.f64, ndim=1),
    planes_z: ti.types.ndarray(dtype=ti.f64, ndim=1),
    block: ti.types.ndarray(dtype=ti.i32, ndim=2),
    block_group: ti.types.ndarray(dtype=ti.i32, ndim=1),
    x: ti.types.ndarray(dtype=vec3, ndim=1),
    u: ti.types.ndarray(dtype=vec3, ndim=1),
    C: ti.types.ndarray(dtype=mat3, ndim=1),
    constant: ti.types.ndarray(dtype=ti.f64, ndim=2),
    sums: ti.types.ndarray(dtype=ti.f64, ndim=2),
):
    """u <- keep (u - rigid motion) + new rigid motion for the particles of one group, or of all for group -1.

    motion = (centre, V, w, new V, new w), five rows; recomputes the moments in the sums of the group's blocks.
    """
    for task in range(block.shape[0] * SHARE):
        if task % SHARE != 0:
            continue
        b = task // SHARE
        if group < 0 or block_group[b] == group:
            R, c, c0 = frame_rotation(frame), frame_row(frame, CENTER), frame_row(frame, START_CENTER)
            middle, V0, w0 = frame_row(motion, 0), frame_row(motion, 1), frame_row(motion, 2)
            V1, w1 = frame_row(motion, 3), frame_row(motion, 4)
            total = ti.Vector.zero(ti.f64, MOMENTS)
            fastest = 0.0
            dV, dw = V1 - keep * V0, w1 - keep * w0
            spin = mat3([[0.0, -dw[2], dw[1]], [dw[2], 0.0, -dw[0]], [-dw[1], dw[0], 0.0]])
            for p in range(block[b, 0], block[b, 1]):
                X = R.transpose() @ (x[p] - c) + c0
                _i, _wx, _ax, mx, Dx, _qx = along(planes_x, X[0])
                _j, _wy, _ay, my, Dy, _qy = along(planes_y, X[1])
                _k, _wz, _az, mz, Dz, _qz = along(planes_z, X[2])
                here = x[p] + R @ vec3(mx - X[0], my - X[1], mz - X[2])
                V = keep * u[p] + dV + dw.cross(here - middle)
                G = keep * C[p] + spin
                u[p], C[p] = V, G
                total += moments(here, V, G, spread(R, Dx, Dy, Dz), constant[p, PARTICLE_MASS])
                fastest = ti.max(fastest, V.norm_sqr())
            for s in ti.static(range(MOMENTS)):
                sums[b, s] = total[s]
            sums[b, SQUARED_SPEED] = fastest


@ti.kernel
def carry_points(
    chosen: ti.types.ndarray(dtype=ti.i32, ndim=1),
    near: ti.types.ndarray(dtype=ti.i32, ndim=2),
    weight: ti.types.ndarray(dtype=ti.f64, ndim=2),
    start: ti.types.ndarray(dtype=ti.f64, ndim=2),
    start_x: ti.types.ndarray(dtype=ti.f64, ndim=2),
    place: ti.types.ndarray(dtype=ti.i32, ndim=1),
    x: ti.types.ndarray(dtype=vec3, ndim=1),
    F: ti.types.ndarray(dtype=mat3, ndim=1),
    out: ti.types.ndarray(dtype=ti.f64, ndim=2),
):
    """Current places of chosen points of the start pose: out_n = sum_p w_np (x_p + F_p (X_n - X_p)).

    near[n] are particles by their start order, start_x[p] their start positions; place[p] is their index in x and F.
    """
    for a in range(chosen.shape[0]):
        n = chosen[a]
        total = vec3(0.0)
        X = vec3(start[n, 0], start[n, 1], start[n, 2])
        for k in range(near.shape[1]):
            p = near[n, k]
            q = place[p]
            total += weight[n, k] * (x[q] + F[q] @ (X - vec3(start_x[p, 0], start_x[p, 1], start_x[p, 2])))
        for d in ti.static(range(3)):
            out[n, d] = total[d]


@ti.kernel
def push_points(
    chosen: ti.types.ndarray(dtype=ti.i32, ndim=1),
    impulse: ti.types.ndarray(dtype=ti.f64, ndim=2),
    at: ti.types.ndarray(dtype=ti.f64, ndim=2),
    near: ti.types.ndarray(dtype=ti.i32, ndim=2),
    weight: ti.types.ndarray(dtype=ti.f64, ndim=2),
    place: ti.types.ndarray(dtype=ti.i32, ndim=1),
    frame: ti.types.ndarray(dtype=ti.f64, ndim=2),
    planes_x: ti.types.ndarray(dtype=ti.f64, ndim=1),
    planes_y: ti.types.ndarray(dtype=ti.f64, ndim=1),
    planes_z: ti.types.ndarray(dtype=ti.f64, ndim=1),
    x: ti.types.ndarray(dtype=vec3, ndim=1),
    u: ti.types.ndarray(dtype=vec3, ndim=1),
    C: ti.types.ndarray(dtype=mat3, ndim=1),
    constant: ti.types.ndarray(dtype=ti.f64, ndim=2),
):
    """Distribute impulses [N s] at points chosen[a] to the particles that carry them by their shares: a point now at
    `at` moves with u_p + C_p (at - xm_p), so its impulse j adds j / m to u and j (at - xm)^T D^-1 / m to C."""
    ti.loop_config(serialize=True)
    for a in range(chosen.shape[0]):
        R, c, c0 = frame_rotation(frame), frame_row(frame, CENTER), frame_row(frame, START_CENTER)
        n = chosen[a]
        j = vec3(impulse[a, 0], impulse[a, 1], impulse[a, 2])
        target = vec3(at[a, 0], at[a, 1], at[a, 2])
        for k in range(near.shape[1]):
            p = place[near[n, k]]
            X = R.transpose() @ (x[p] - c) + c0
            _i, _wx, _ax, mx, Dx, _qx = along(planes_x, X[0])
            _j, _wy, _ay, my, Dy, _qy = along(planes_y, X[1])
            _k, _wz, _az, mz, Dz, _qz = along(planes_z, X[2])
            arm = R.transpose() @ (target - c) + c0 - vec3(mx, my, mz)
            own = (weight[n, k] / constant[p, PARTICLE_MASS]) * j
            u[p] += own
            C[p] += own.outer_product(vec3(arm[0] / Dx, arm[1] / Dy, arm[2] / Dz)) @ R.transpose()
