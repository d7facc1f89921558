"""Impulses between a rigid body and the grid's nodes inside it: two-way coupling after [H18, Sec. 5].

All touching nodes and the body exchange impulses at once; the body's velocity q = (V, w) is taken at the end of the
exchange, so light bodies on heavy material are stable. With G = [I, -[r]x], so that G q is the body's velocity at a
node, and A = m (n n^T + s (I - n n^T)) for the share s of the node's tangential motion that friction stops,

    (M + sum G^T A G) q' = M q + sum G^T A v

is solved with the shares of the last q' until it stays; nodes then take their impulses at q' and the body exactly the
opposite. Where nodes come into touch and leave it in turn, no q' may stay: the last one is used, and `couple` tells how
much it still changed.

[H18] Hu, Fang, Ge, Qu, Zhu, Pradhana, Jiang: A moving least squares material point method with displacement
discontinuity and two-way rigid body coupling. SIGGRAPH 2018.
"""

import taichi as ti

from solver.kernels.elastic import mat3, vec3
from solver.kernels.mls_columns import (
    CENTER,
    DYNAMIC,
    GRID_LOW,
    MATERIAL_MASS,
    NODE_MASS,
    SPAN_COUNT,
    STATIC,
    node_in_span,
    vector_at,
)
from solver.kernels.query import FAR

vec6 = ti.types.vector(6, ti.f64)

SETTLED = 1e-12  # relative change of q' at which a coupling's sweeps stop
SWEEPS = 60  # most of a coupling: what contracts by SETTLED**(1 / 60) = 0.63 per sweep settles. Among random nodes a
# body as heavy as they are takes 7 to 13 sweeps, one of a ten-thousandth of that up to 59, and some never settle

# columns of what `couple` tells of each owner of nodes; vectors and the matrix start at theirs
LOAD = 0  # sum of normal impulses
IMPULSE = 1  # on the material, 3 columns
NORMAL_MATRIX = 4  # sum of G^T n n^T G weighted by normal impulse, 6 x 6 row-major
NORMAL_IMPULSE = 40  # part of the impulse along the normals, 3 columns
COUPLED = 43  # columns in all

# columns of a touching node
NORMAL = 0  # out of the body
ARM = 3  # from the body's centre
VELOCITY = 6  # before the exchange
MASS = 9
FRICTION = 10  # static, dynamic
TOUCHING = 12  # columns in all
# of its numbers
NODE = 0
OWNER = 1


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


@ti.func
def material_touches(
    node: ti.i32, n: vec3, phi: ti.f64, h: ti.f64, least_mass: ti.f64, material: ti.template(), grid: ti.template()
) -> ti.i32:
    """Whether the material that a node feels reaches the body's surface, told by its centroid."""
    there = material[node, MATERIAL_MASS]
    offset = FAR
    if grid[node, NODE_MASS] > least_mass and there > 0.0:
        offset = (vector_at(material, node, 0) / there).dot(n)
    return offset <= h * touching_centroid(-phi / h)


@ti.func
def write_touching(
    t: ti.i32, number: ti.template(), touching: ti.template(), node: ti.i32, n: vec3, r: vec3, owner: ti.i32,
    friction: ti.template(), grid: ti.template(),
):  # fmt: skip
    """Fill the t-th row of the touching nodes."""
    number[t, NODE], number[t, OWNER] = node, owner
    v = vector_at(grid, node, 0)
    for a in ti.static(range(3)):
        touching[t, NORMAL + a], touching[t, ARM + a], touching[t, VELOCITY + a] = n[a], r[a], v[a]
    touching[t, MASS] = grid[node, NODE_MASS]
    touching[t, FRICTION + STATIC], touching[t, FRICTION + DYNAMIC] = friction[owner, STATIC], friction[owner, DYNAMIC]


@ti.func
def impulse_at(t: ti.i32, touching: ti.template(), q: vec6):
    """node_impulse of the t-th touching node where the body moves with q."""
    u = vector_at(touching, t, VELOCITY) - vec3(q[0], q[1], q[2])
    u -= vec3(q[3], q[4], q[5]).cross(vector_at(touching, t, ARM))
    friction = touching[t, FRICTION + STATIC], touching[t, FRICTION + DYNAMIC]
    return node_impulse(u, vector_at(touching, t, NORMAL), touching[t, MASS], friction[0], friction[1])


@ti.func
def write_system(K: ti.template(), mass: ti.template(), right: vec6):
    """K = [M, right side]."""
    for a in ti.static(range(6)):
        for d in ti.static(range(6)):
            K[a, d] = mass[a, d]
        K[a, 6] = right[a]


@ti.func
def add_node(K: ti.template(), t: ti.i32, touching: ti.template(), share: ti.f64):
    """K += [G^T A G, G^T A v] of the t-th touching node; share is s."""
    n, r = vector_at(touching, t, NORMAL), vector_at(touching, t, ARM)
    A = touching[t, MASS] * (share * ti.Matrix.identity(ti.f64, 3) + (1.0 - share) * n.outer_product(n))
    X = mat3([[0.0, -r[2], r[1]], [r[2], 0.0, -r[0]], [-r[1], r[0], 0.0]])
    XA = X @ A
    XAX = XA @ X.transpose()
    f = A @ vector_at(touching, t, VELOCITY)
    moment = r.cross(f)
    for a in ti.static(range(3)):
        K[a, 6] += f[a]
        K[3 + a, 6] += moment[a]
        for d in ti.static(range(3)):
            K[a, d] += A[a, d]
            K[3 + a, d] += XA[a, d]
            K[d, 3 + a] += XA[a, d]
            K[3 + a, 3 + d] += XAX[a, d]


@ti.func
def velocity_after(
    q0: vec6, count: ti.i32, touching: ti.template(), mass: ti.template(), K: ti.template(), q: ti.template()
):
    """Fill q with the velocity q' of the body by sweeps over the shares that friction stops; returns it, and its last
    change over the larger of q' and q0."""
    momentum = vec6(0.0)
    for a in ti.static(range(6)):
        for d in ti.static(range(6)):
            momentum[a] += mass[a, d] * q0[d]
    now = q0
    change = 0.0
    sweep, moving = 0, True
    while moving and sweep < SWEEPS:
        sweep += 1
        write_system(K, mass, momentum)
        for t in range(count):
            _impulse, load, share = impulse_at(t, touching, now)
            if load > 0.0:
                add_node(K, t, touching, share)
        solve6(K, q)
        before = now
        for a in ti.static(range(6)):
            now[a] = q[a]
        change = (now - before).norm()
        moving = change > SETTLED * now.norm()
    if change > 0.0:  # at rest q' is what rounding leaves of q0
        change /= ti.max(now.norm(), q0.norm())
    return now, change


@ti.func
def add_received(out: ti.template(), o: ti.i32, n: vec3, r: vec3, impulse: vec3, load: ti.f64):
    """Add what one node received to its owner's row of `out`."""
    rn = r.cross(n)
    Gn = vec6(n[0], n[1], n[2], rn[0], rn[1], rn[2])
    out[o, LOAD] += load
    for a in ti.static(range(3)):
        out[o, IMPULSE + a] += impulse[a]
        out[o, NORMAL_IMPULSE + a] += load * n[a]
    for a in ti.static(range(6)):
        for d in ti.static(range(6)):
            out[o, NORMAL_MATRIX + 6 * a + d] += load * Gn[a] * Gn[d]


@ti.func
def give_impulses(
    q: vec6, count: ti.i32, number: ti.template(), touching: ti.template(), grid: ti.template(), out: ti.template()
):
    """Change the nodes' velocities by their impulses at q; returns the sum of impulses and moments on them."""
    total = vec6(0.0)
    for t in range(count):
        impulse, load, _share = impulse_at(t, touching, q)
        if load > 0.0:
            r = vector_at(touching, t, ARM)
            moment = r.cross(impulse)
            add_received(out, number[t, OWNER], vector_at(touching, t, NORMAL), r, impulse, load)
            for a in ti.static(range(3)):
                total[a] += impulse[a]
                total[3 + a] += moment[a]
                grid[number[t, NODE], a] = touching[t, VELOCITY + a] + impulse[a] / touching[t, MASS]
    return total


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
    number: ti.types.ndarray(dtype=ti.i32, ndim=2),
    touching: ti.types.ndarray(dtype=ti.f64, ndim=2),
    last_change: ti.types.ndarray(dtype=ti.f64, ndim=1),
    out: ti.types.ndarray(dtype=ti.f64, ndim=2),
):
    """Let a rigid body and the nodes within `reach` of its inside exchange impulses.

    out[o] takes the columns above of what owner o of nodes received, last_change (1,) the change of a free body's
    velocity in the last sweep over the larger of q' and q: above SETTLED, SWEEPS were not enough. Of K (6, 7),
    number (s, 2) and touching (s, TOUCHING), with s nodes in the span, nothing that they held matters.
    """
    ti.loop_config(serialize=True)
    for _ in range(1):
        count = 0
        for s in range(span[SPAN_COUNT, 0] * span[SPAN_COUNT, 1] * span[SPAN_COUNT, 2]):
            if phi[s] <= reach:
                index, n = node_in_span(s, span), vector_at(normal, s, 0)
                node = (index[0] * nodes_y + index[1]) * nodes_z + index[2]
                if material_touches(node, n, phi[s], h, least_mass, material, grid):
                    r = vector_at(frame, GRID_LOW, 0) - vector_at(frame, CENTER, 0) + h * ti.cast(index, ti.f64)
                    write_touching(count, number, touching, node, n, r, owner[node], friction, grid)
                    count += 1
        q0 = vec6(q[0], q[1], q[2], q[3], q[4], q[5])
        moves = free == 1 and count > 0
        after, change = q0, 0.0
        if moves:
            after, change = velocity_after(q0, count, touching, mass, K, q)
        last_change[0] = change
        total = give_impulses(after, count, number, touching, grid, out)
        if moves:
            write_system(K, mass, -total)
            solve6(K, q)
            for a in ti.static(range(6)):
                q[a] += q0[a]
