"""Contact query for rigid and soft bodies: position of a world point in a body's start pose, and distance from its
surface.

The signed distance is read from grid samples with quadratic B-splines, which makes the gap and its normal continuous; a
plane is reproduced exactly, a curved surface is offset by spacing^2 / 8 times the sum of its principal curvatures [U99,
uniform B-spline smoothing]. For a soft body the deformation map is inverted by Newton on its trilinear grid map,
warm-started at the point's previous place.

[U99] Unser: Splines, a perfect fit for signal and image processing. IEEE Signal Processing Magazine 16(6), 1999.
"""

import taichi as ti

from solver.kernels.elastic import cofactor, load3, mat3, shape_gradient, vec3

FAR = 1e9  # gap [m] that means: outside the sampled region, no contact possible
# a distance has slope 1; below this slope the nearest surface is ambiguous (a medial axis) and there is no normal
LEAST_SLOPE = 0.1
INVERSION_STEPS = 20  # Newton on a piecewise trilinear map: 3 to 5 inside one cell, one more per cell face crossed
LEAST_VOLUME = 1e-3  # smallest det F at which a map is inverted [-]
SURFACE_STEPS = 3  # steps towards the nearest place of the surface: each removes the remaining offset from the normal
OUTSIDE, UNLOCATED = -1, -2  # instead of a cell: no cell contains the point; the inversion ended inside, but not at it
INVERSION_TOLERANCE = 1e-8  # [m], far below any gap that matters


@ti.func
def distance_at(X: vec3, origin: vec3, spacing: ti.f64, values: ti.template()):
    """Signed distance [m] and its gradient at X; FAR outside the samples."""
    gap = FAR
    normal = vec3(0.0, 0.0, 0.0)
    q = (X - origin) / spacing
    base = ti.Vector(
        [
            ti.cast(ti.floor(q[0] + 0.5), ti.i32),
            ti.cast(ti.floor(q[1] + 0.5), ti.i32),
            ti.cast(ti.floor(q[2] + 0.5), ti.i32),
        ]
    )
    inside = True
    for d in ti.static(range(3)):
        if base[d] < 1 or base[d] > values.shape[d] - 2:
            inside = False
    if inside:
        gap = 0.0
        w = ti.Matrix.zero(ti.f64, 3, 3)
        g = ti.Matrix.zero(ti.f64, 3, 3)
        for d in ti.static(range(3)):
            t = q[d] - base[d]
            w[d, 0], w[d, 1], w[d, 2] = 0.5 * (0.5 - t) ** 2, 0.75 - t * t, 0.5 * (0.5 + t) ** 2
            g[d, 0], g[d, 1], g[d, 2] = t - 0.5, -2.0 * t, t + 0.5
        for i in ti.static(range(3)):
            for j in ti.static(range(3)):
                for k in ti.static(range(3)):
                    v = ti.cast(values[base[0] + i - 1, base[1] + j - 1, base[2] + k - 1], ti.f64)
                    gap += w[0, i] * w[1, j] * w[2, k] * v
                    normal += v * vec3(
                        g[0, i] * w[1, j] * w[2, k], w[0, i] * g[1, j] * w[2, k], w[0, i] * w[1, j] * g[2, k]
                    )
        normal /= spacing
    return gap, normal


@ti.func
def plane_interval(planes: ti.template(), value: ti.f64) -> ti.i32:
    """Index i with planes[i] <= value < planes[i + 1], clamped to the valid range."""
    low, high = 0, planes.shape[0] - 2
    while low < high:
        middle = (low + high + 1) // 2
        if planes[middle] <= value:
            low = middle
        else:
            high = middle - 1
    return low


@ti.func
def shape_value(a: ti.i32, s: vec3) -> ti.f64:
    """Trilinear shape value of local node a = 4 i + 2 j + k at local coordinates s."""
    wx = s[0] if a // 4 == 1 else 1.0 - s[0]
    wy = s[1] if (a // 2) % 2 == 1 else 1.0 - s[1]
    wz = s[2] if a % 2 == 1 else 1.0 - s[2]
    return wx * wy * wz


@ti.kernel
def query_rigid(
    points: ti.types.ndarray(),
    candidates: ti.types.ndarray(),
    rotation: ti.types.ndarray(),
    center: ti.types.ndarray(),
    start_center: ti.types.ndarray(),
    origin: ti.types.ndarray(),
    spacing: ti.f64,
    values: ti.types.ndarray(),
    material_point: ti.types.ndarray(),
    gap: ti.types.ndarray(),
    normal: ti.types.ndarray(),
):
    """Gap and outward world normal of a rigid body at the candidate points; material_point is the point in its
    start pose."""
    Q = mat3(0.0)
    c, c0, o = vec3(0.0), vec3(0.0), vec3(0.0)
    for i in ti.static(range(3)):
        c[i], c0[i], o[i] = center[i], start_center[i], origin[i]
        for j in ti.static(range(3)):
            Q[i, j] = rotation[i, j]
    for m in range(candidates.shape[0]):
        p = candidates[m]
        x = vec3(points[p, 0], points[p, 1], points[p, 2])
        X = Q.transpose() @ (x - c) + c0
        phi, N = distance_at(X, o, spacing, values)
        gap[m] = FAR
        if phi < FAR and N.norm() > LEAST_SLOPE:
            n = (Q @ N).normalized()
            gap[m] = phi
            for d in ti.static(range(3)):
                normal[m, d] = n[d]
        for d in ti.static(range(3)):
            material_point[m, d] = X[d]


@ti.kernel
def average_deformation(
    nodes: ti.types.ndarray(),
    x: ti.types.ndarray(),
    cell_node: ti.types.ndarray(),
    cell_size: ti.types.ndarray(),
    node_cell: ti.types.ndarray(),
    F_out: ti.types.ndarray(),
):
    """Deformation gradient at the listed nodes, averaged over the cells around each node: continuous when interpolated.

    The gradient itself jumps at cell faces; a contact normal pushed forward with it would jump too, and Newton would
    cycle.
    """
    for m in range(nodes.shape[0]):
        node = nodes[m]
        F = ti.Matrix.zero(ti.f64, 3, 3)
        count = 0.0
        for o in range(8):
            c = node_cell[node, o]
            if c >= 0:
                local = 7 - o
                s = vec3(ti.cast(local // 4, ti.f64), ti.cast((local // 2) % 2, ti.f64), ti.cast(local % 2, ti.f64))
                h = vec3(cell_size[c, 0], cell_size[c, 1], cell_size[c, 2])
                count += 1.0
                for a in range(8):
                    n = cell_node[c, a]
                    F += vec3(x[n, 0], x[n, 1], x[n, 2]).outer_product(shape_gradient(a, s, h))
        for i in ti.static(range(3)):
            for j in ti.static(range(3)):
                F_out[node, 3 * i + j] = F[i, j] / count


@ti.func
def cell_around(
    X: vec3,
    planes_x: ti.template(),
    planes_y: ti.template(),
    planes_z: ti.template(),
    cell_id: ti.template(),
):
    """The cell of the start pose that contains X, negative if there is none; local coordinates of X in the grid's cell,
    beyond [0, 1] outside the grid; and the size of that cell [m]."""
    i, j, k = plane_interval(planes_x, X[0]), plane_interval(planes_y, X[1]), plane_interval(planes_z, X[2])
    low = vec3(planes_x[i], planes_y[j], planes_z[k])
    h = vec3(planes_x[i + 1], planes_y[j + 1], planes_z[k + 1]) - low
    return cell_id[i, j, k], (X - low) / h, h


@ti.func
def invert(
    target: vec3,
    start: vec3,
    x: ti.template(),
    planes_x: ti.template(),
    planes_y: ti.template(),
    planes_z: ti.template(),
    cell_id: ti.template(),
    cell_node: ti.template(),
):
    """Newton from `start` for the X with x(X) = target: the cell that contains X (or OUTSIDE, or UNLOCATED), and X."""
    X = start
    cell, count = UNLOCATED, 0
    running = True
    while running and count < INVERSION_STEPS:
        count += 1
        c, s, h = cell_around(X, planes_x, planes_y, planes_z, cell_id)
        cell = UNLOCATED
        if c < 0 or s.min() < -1e-6 or s.max() > 1.0 + 1e-6:
            cell = OUTSIDE
        if c < 0:
            running = False
        else:
            here = vec3(0.0)
            F = ti.Matrix.zero(ti.f64, 3, 3)
            for a in range(8):
                n = cell_node[c, a]
                xa = vec3(x[n, 0], x[n, 1], x[n, 2])
                here += shape_value(a, s) * xa
                F += xa.outer_product(shape_gradient(a, s, h))
            J = F.determinant()
            r = target - here
            if J < LEAST_VOLUME:
                running = False
            elif r.norm() < INVERSION_TOLERANCE:
                running = False
                if cell == UNLOCATED:
                    cell = c
            else:
                step = cofactor(F).transpose() @ r / J
                longest = 1.5 * h.max()
                if step.norm() > longest:
                    step *= longest / step.norm()
                X += step
    return cell, X


@ti.func
def smooth_map(c: ti.i32, s: vec3, x: ti.template(), cell_node: ti.template(), smooth: ti.template()):
    """Position of the point at local coordinates s of cell c [m], and the interpolated average deformation of its
    nodes."""
    here, F = vec3(0.0), mat3(0.0)
    for a in range(8):
        w, n = shape_value(a, s), cell_node[c, a]
        here += w * vec3(x[n, 0], x[n, 1], x[n, 2])
        F += w * load3(smooth, n)
    return here, F


@ti.func
def nearest_surface(
    target: vec3,
    X: vec3,
    folded: bool,
    x: ti.template(),
    planes_x: ti.template(),
    planes_y: ti.template(),
    planes_z: ti.template(),
    cell_id: ti.template(),
    cell_node: ti.template(),
    smooth: ti.template(),
    origin: vec3,
    spacing: ti.f64,
    values: ti.template(),
):
    """The place of a body's deformed surface nearest to a point inside, starting from the material point X near it: its
    cell and local coordinates, the world normal n, and the gap [m], FAR if no place is found.

    Near a material point Y with distance phi and normal N the surface is the plane with n ~ F^-T N at phi / |F^-T N|
    further along n; each step goes to where target - x(Y) is along n, and onto phi = 0. For a point outside, X itself
    is sufficient. With `folded`, X is not an inverse of target, and a place outside the body is not used.
    """
    cell, local, normal, gap = UNLOCATED, vec3(0.0), vec3(0.0), FAR
    Y, running, count = X, True, 0
    while running and count <= SURFACE_STEPS:
        running = False
        c, s, h = cell_around(Y, planes_x, planes_y, planes_z, cell_id)
        if c >= 0:
            here, F = smooth_map(c, s, x, cell_node, smooth)
            phi, N = distance_at(Y, origin, spacing, values)
            J = F.determinant()
            inside = count > 0 or phi < 0.0
            if phi < FAR and N.norm() > LEAST_SLOPE and J > LEAST_VOLUME and (inside or not folded):
                N = N.normalized()
                pushed = cofactor(F) @ N / J
                cell, local, normal = c, s, pushed.normalized()
                away = target - here
                gap = away.dot(normal) + phi / pushed.norm()
                along = cofactor(F).transpose() @ (away - away.dot(normal) * normal) / J
                longest = 0.5 * h.min()
                if along.norm() > longest:
                    along *= longest / along.norm()
                Y += along - phi * N
                running = inside
        count += 1
    return cell, local, normal, gap


@ti.kernel
def query_soft(
    points: ti.types.ndarray(),
    candidates: ti.types.ndarray(),
    x: ti.types.ndarray(),
    planes_x: ti.types.ndarray(),
    planes_y: ti.types.ndarray(),
    planes_z: ti.types.ndarray(),
    cell_id: ti.types.ndarray(),
    cell_node: ti.types.ndarray(),
    smooth: ti.types.ndarray(),
    origin: ti.types.ndarray(),
    spacing: ti.f64,
    values: ti.types.ndarray(),
    undeformed: ti.types.ndarray(),
    material_point: ti.types.ndarray(),
    gap: ti.types.ndarray(),
    normal: ti.types.ndarray(),
    cell: ti.types.ndarray(),
    weight: ti.types.ndarray(),
):
    """The same for a soft body: invert x(X), and measure from the nearest place of the deformed surface.

    The inversion starts at material_point[m], the point's last place (NaN: none), and if that fails at undeformed[m],
    its place if the body had only moved rigidly. cell[m] is a global cell (or OUTSIDE, or UNLOCATED), weight the 8
    shape values in it of the place on the surface that the contact pushes.

    Where cells fold over themselves, as under a sharp edge, x(X) = target has several solutions or none, but the
    surface does not jump: there the last X of the inversion is used.
    """
    o = vec3(0.0)
    for d in ti.static(range(3)):
        o[d] = origin[d]
    for m in range(candidates.shape[0]):
        p = candidates[m]
        target = vec3(points[p, 0], points[p, 1], points[p, 2])
        found = UNLOCATED
        X = vec3(material_point[m, 0], material_point[m, 1], material_point[m, 2])
        if X[0] == X[0]:
            found, X = invert(target, X, x, planes_x, planes_y, planes_z, cell_id, cell_node)
        if found < 0:
            start = vec3(undeformed[m, 0], undeformed[m, 1], undeformed[m, 2])
            again, other = invert(target, start, x, planes_x, planes_y, planes_z, cell_id, cell_node)
            if again > found or X[0] != X[0]:  # a cell if there is one, OUTSIDE if either inversion ended there
                found, X = again, other
        for d in ti.static(range(3)):
            material_point[m, d] = X[d]
        cell[m], gap[m] = found, FAR
        if found != OUTSIDE:
            c, s, n, depth = nearest_surface(
                target, X, found == UNLOCATED, x, planes_x, planes_y, planes_z, cell_id, cell_node, smooth, o, spacing,
                values,
            )  # fmt: skip
            gap[m] = depth
            if c >= 0:
                cell[m] = c
                for d in ti.static(range(3)):
                    normal[m, d] = n[d]
                for a in range(8):
                    weight[m, a] = shape_value(a, s)


@ti.kernel
def largest_particle_speed(
    cell_node: ti.types.ndarray(),
    cell_start: ti.types.ndarray(),
    local: ti.types.ndarray(),
    real: ti.types.ndarray(),
    v: ti.types.ndarray(),
) -> ti.f64:
    """Largest speed [m/s] of a material particle; the speed of nodes with hardly any material has no meaning."""
    largest = 0.0
    for c in range(cell_node.shape[0]):
        for p in range(cell_start[c], cell_start[c + 1]):
            if real[p] != 0:
                s = vec3(local[p, 0], local[p, 1], local[p, 2])
                velocity = vec3(0.0)
                for a in range(8):
                    n = cell_node[c, a]
                    velocity += shape_value(a, s) * vec3(v[n, 0], v[n, 1], v[n, 2])
                ti.atomic_max(largest, velocity.norm())
    return largest
