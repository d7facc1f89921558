"""Where the grid's nodes and the particles are relative to rigid bodies: distances, normals, sides of thin ones.

[H18] Hu, Fang, Ge, Qu, Zhu, Pradhana, Jiang: A moving least squares material point method with displacement
discontinuity and two-way rigid body coupling. SIGGRAPH 2018.
"""

import taichi as ti

from solver.kernels.elastic import vec3
from solver.kernels.mls_columns import (
    CENTER,
    GRID_LOW,
    MATERIAL_MASS,
    NODE_MASS,
    ROTATION,
    SAMPLE_ORIGIN,
    SIDE_DISTANCE,
    SIDE_MARK,
    SPAN_COUNT,
    START_CENTER,
    node_in_span,
    vector_at,
)
from solver.kernels.query import FAR, LEAST_SLOPE, distance_at

PROBES = 4  # points beneath a surface point where the body's end is looked for
OPPOSED = -0.866  # cosine between normals of opposite faces: a wedge of 30 degrees has two sides, a rim none


@ti.func
def distance_and_normal(x: vec3, frame: ti.template(), spacing: ti.f64, values: ti.template()):
    """Signed distance of a rigid body at a world point and its outward normal, zero midway between two surfaces."""
    Q = ti.Matrix.rows([vector_at(frame, ROTATION + i, 0) for i in ti.static(range(3))])
    o = vector_at(frame, SAMPLE_ORIGIN, 0)
    X = Q.transpose() @ (x - vector_at(frame, CENTER, 0)) + vector_at(frame, START_CENTER, 0)
    inner = X
    for a in ti.static(range(3)):  # samples end a little outside of the body; go on linearly from their edge
        inner[a] = ti.math.clamp(X[a], o[a] + 0.6 * spacing, o[a] + (values.shape[a] - 1.6) * spacing)
    phi, N = distance_at(inner, o, spacing, values)
    n = vec3(0.0)
    if phi < FAR and N.norm() > LEAST_SLOPE:
        phi += N.dot(X - inner)
        n = (Q @ N).normalized()
    return phi, n


@ti.func
def lies_over_thin_part(
    phi: ti.f64, n: vec3, x: vec3, thickness: ti.f64, frame: ti.template(), spacing: ti.f64, values: ti.template()
) -> ti.i32:
    """Whether beneath the body's surface point nearest to x the body ends within `thickness`, in a face opposite to
    that one. So nothing beyond a rim is on a side, as in [H18, Sec. 5.1], where sides end with the faces."""
    thin, inside = 0, 1
    if n.norm_sqr() == 0.0:  # midway between two surfaces
        thin = phi > -0.5 * thickness
        inside = 0
    for k in range(PROBES):
        if inside == 1:
            depth = (k + 1.0) / PROBES * thickness
            beyond, opposite = distance_and_normal(x - (phi + depth) * n, frame, spacing, values)
            if beyond > 0.0:
                inside = 0
                thin = n.dot(opposite) < OPPOSED
    return thin


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
    least_mass and are not held."""
    for s in range(span[SPAN_COUNT, 0] * span[SPAN_COUNT, 1] * span[SPAN_COUNT, 2]):
        index = node_in_span(s, span)
        phi[s] = FAR
        node = (index[0] * nodes_y + index[1]) * nodes_z + index[2]
        if grid[node, NODE_MASS] > least_mass and held[node] == 0:
            x = vector_at(frame, GRID_LOW, 0) + h * ti.cast(index, ti.f64)
            d, n = distance_and_normal(x, frame, spacing, values)
            if n.norm_sqr() > 0.0:
                phi[s] = d
            for a in ti.static(range(3)):
                normal[s, a] = n[a]


@ti.kernel
def sides_at_nodes(
    mark: ti.f64,
    thickness: ti.f64,
    h: ti.f64,
    nodes_y: ti.i32,
    nodes_z: ti.i32,
    reach: ti.f64,
    frame: ti.types.ndarray(dtype=ti.f64, ndim=2),
    span: ti.types.ndarray(dtype=ti.i32, ndim=2),
    spacing: ti.f64,
    values: ti.types.ndarray(dtype=ti.f32, ndim=3),
    material: ti.types.ndarray(dtype=ti.f64, ndim=2),
    node_side: ti.types.ndarray(dtype=ti.f64, ndim=2),
    met: ti.types.ndarray(dtype=ti.i32, ndim=2),
):
    """Which side of a rigid body each node within `reach` of a part of it thinner than `thickness` is on.

    A node that was on a side of another body is on this one's from now on, and where it has material,
    met[other, this] (counted from 0) becomes 1.
    """
    for s in range(span[SPAN_COUNT, 0] * span[SPAN_COUNT, 1] * span[SPAN_COUNT, 2]):
        index = node_in_span(s, span)
        x = vector_at(frame, GRID_LOW, 0) + h * ti.cast(index, ti.f64)
        phi, n = distance_and_normal(x, frame, spacing, values)
        if phi < reach and lies_over_thin_part(phi, n, x, thickness, frame, spacing, values):
            node = (index[0] * nodes_y + index[1]) * nodes_z + index[2]
            other = ti.cast(node_side[node, SIDE_MARK], ti.i32)
            if other > 0 and material[node, MATERIAL_MASS] > 0.0:
                met[other - 1, ti.cast(mark, ti.i32) - 1] = 1
            for a in ti.static(range(3)):
                node_side[node, a] = n[a]
            node_side[node, SIDE_MARK] = mark


@ti.kernel
def sides_of_particles(
    mark: ti.f64,
    thickness: ti.f64,
    reach: ti.f64,
    frame: ti.types.ndarray(dtype=ti.f64, ndim=2),
    spacing: ti.f64,
    values: ti.types.ndarray(dtype=ti.f32, ndim=3),
    x: ti.types.ndarray(dtype=ti.f64, ndim=2),
    side: ti.types.ndarray(dtype=ti.f64, ndim=2),
    met: ti.types.ndarray(dtype=ti.i32, ndim=2),
):
    """The same for particles, with their distance; one that was near before stays on its side, also where it has been
    pressed through. To be asked of bodies in the order of their marks: a lower one was then given just now."""
    for p in range(x.shape[0]):
        X = vector_at(x, p, 0)
        phi, n = distance_and_normal(X, frame, spacing, values)
        near = phi < reach and lies_over_thin_part(phi, n, X, thickness, frame, spacing, values)
        if near and n.norm_sqr() > 0.0:
            other = ti.cast(side[p, SIDE_MARK], ti.i32)
            if other > 0 and other < ti.cast(mark, ti.i32):
                met[other - 1, ti.cast(mark, ti.i32) - 1] = 1
            before = vector_at(side, p, 0)
            if side[p, SIDE_MARK] == mark and before.dot(n) < 0.0:
                n = -n
                phi = -ti.abs(phi)
            for a in ti.static(range(3)):
                side[p, a] = n[a]
            side[p, SIDE_MARK] = mark
            side[p, SIDE_DISTANCE] = phi
        elif not near and side[p, SIDE_MARK] == mark:
            side[p, SIDE_MARK] = 0.0
