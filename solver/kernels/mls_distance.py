"""Where the grid's nodes and the particles are relative to rigid bodies: distances, normals, sides of thin ones.

[H18] Hu, Fang, Ge, Qu, Zhu, Pradhana, Jiang: A moving least squares material point method with displacement
discontinuity and two-way rigid body coupling. SIGGRAPH 2018.
"""

import taichi as ti

from solver.kernels.elastic import mat3, vec3
from solver.kernels.query import FAR, LEAST_SLOPE, distance_at


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
