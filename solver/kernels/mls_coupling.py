"""Impulses between a rigid body and the grid's nodes inside it: two-way coupling after [H18, Sec. 5].

[H18] Hu, Fang, Ge, Qu, Zhu, Pradhana, Jiang: A moving least squares material point method with displacement
discontinuity and two-way rigid body coupling. SIGGRAPH 2018.
"""

import taichi as ti

from solver.kernels.elastic import mat3, vec3
from solver.kernels.query import FAR

SWEEPS = 20  # of a coupling; the friction law converges in 3 to 6
SETTLED = 1e-12  # relative change of the rigid velocity at which a coupling's sweeps stop

# columns of what `couple` tells of each owner of nodes; vectors and the matrix start at theirs
LOAD = 0  # sum of normal impulses
IMPULSE = 1  # on the material, 3 columns
NORMAL_MATRIX = 4  # sum of G^T n n^T G weighted by normal impulse, G = [I, -[r]x], 6 x 6 row-major
NORMAL_IMPULSE = 40  # part of the impulse along the normals, 3 columns
COUPLED = 43  # columns in all


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

    out[o] takes the columns above of what owner o of nodes received.
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
                turn += r.cross(impulse)
                rn = r.cross(n)
                out[o, LOAD] += load
                for a in ti.static(range(3)):
                    grid[n_, a] = grid[n_, a] + impulse[a] / m
                    out[o, IMPULSE + a] += impulse[a]
                    out[o, NORMAL_IMPULSE + a] += load * n[a]
                    for d in ti.static(range(3)):
                        out[o, NORMAL_MATRIX + 6 * a + d] += load * n[a] * n[d]
                        out[o, NORMAL_MATRIX + 6 * a + 3 + d] += load * n[a] * rn[d]
                        out[o, NORMAL_MATRIX + 6 * (3 + a) + d] += load * rn[a] * n[d]
                        out[o, NORMAL_MATRIX + 6 * (3 + a) + 3 + d] += load * rn[a] * rn[d]
        if free == 1 and count > 0:
            for a in range(6):
                for d in range(6):
                    K[a, d] = mass[a, d]
                K[a, 6] = -total[a] if a < 3 else -turn[a - 3]
            solve6(K, q)
            for a in ti.static(range(6)):
                q[a] += q0[a]
