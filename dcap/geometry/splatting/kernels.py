"""Taichi kernels: projection of Gaussians, tiles, front-to-back blending, and crossings of their density.

Sources: elliptical weighted averages [Z01] as in 3D Gaussian splatting [K23]; density and level set as in SuGaR [G24].

[Z01] Zwicker, Pfister, van Baar, Gross: EWA volume splatting. IEEE Visualization 2001.
[K23] Kerbl, Kopanas, Leimkuehler, Drettakis: 3D Gaussian splatting for real-time radiance field rendering. ACM Trans.
Graph. 42(4), 2023.
[G24] Guedon, Lepetit: SuGaR: surface-aligned Gaussian splatting for efficient 3D mesh reconstruction. CVPR 2024.
[O11] Ozertem, Erdogmus: Locally defined principal curves and surfaces. J. Mach. Learn. Res. 12, 2011.
"""

import taichi as ti

vec2f = ti.types.vector(2, ti.f32)
vec3f = ti.types.vector(3, ti.f32)
mat3f = ti.types.matrix(3, 3, ti.f32)

TILE = 16  # pixels along a side of a tile
BLUR = 0.3  # variance [pixel^2] added to every projected Gaussian: none is thinner than a pixel [K23]
FAINT = 1.0 / 255.0  # opacity below which a Gaussian does not contribute to a pixel [K23]
SOLID = 0.99  # largest opacity of one Gaussian at a pixel [K23]
SPENT = 1e-3  # a pixel that lets less light than this through is finished
WIDE = (
    1.3  # how far outside of the picture a Gaussian's centre is projected as it is, over the half field of view [K23]
)
LEAST = 512  # Taichi gives a thread at least this many iterations: a tile counts as 512


@ti.kernel
def project(
    position: ti.types.ndarray(dtype=vec3f, ndim=1),
    axes: ti.types.ndarray(dtype=mat3f, ndim=1),
    scale: ti.types.ndarray(dtype=vec3f, ndim=1),
    opacity: ti.types.ndarray(),
    rotation: mat3f,
    shift: vec3f,
    focal: vec2f,
    center: vec2f,
    size: ti.types.vector(2, ti.i32),
    near: ti.f32,
    depth: ti.types.ndarray(),
    mean: ti.types.ndarray(dtype=vec2f, ndim=1),
    conic: ti.types.ndarray(dtype=vec3f, ndim=1),
    rectangle: ti.types.ndarray(),
):
    """Depth along the optical axis [m] (negative: not in the picture), centre [pixel], inverse covariance (xx, xy, yy)
    [1/pixel^2] and the pixels (first and one past the last column, the same for rows) that each Gaussian may reach.

    Camera axes: x to the right, y down, z forward; p_camera = rotation p + shift.
    """
    for g in range(position.shape[0]):
        depth[g] = -1.0
        p = rotation @ position[g] + shift
        if p[2] > near and opacity[g] > FAINT:
            limit_x = WIDE * 0.5 * size[0] / focal[0]
            limit_y = WIDE * 0.5 * size[1] / focal[1]
            tx = ti.min(limit_x, ti.max(-limit_x, p[0] / p[2]))
            ty = ti.min(limit_y, ti.max(-limit_y, p[1] / p[2]))
            # rows of the projection's derivative times the axes scaled by their deviations
            M = rotation @ axes[g]
            a, b = vec3f(0.0), vec3f(0.0)
            for k in ti.static(range(3)):
                a[k] = focal[0] / p[2] * (M[0, k] - tx * M[2, k]) * scale[g][k]
                b[k] = focal[1] / p[2] * (M[1, k] - ty * M[2, k]) * scale[g][k]
            xx, xy, yy = a.dot(a) + BLUR, a.dot(b), b.dot(b) + BLUR
            det = xx * yy - xy * xy
            m = vec2f(focal[0] * p[0] / p[2] + center[0], focal[1] * p[1] / p[2] + center[1])
            # distance at which the opacity falls below FAINT
            reach = ti.sqrt(2.0 * ti.log(opacity[g] / FAINT))
            rx, ry = reach * ti.sqrt(xx), reach * ti.sqrt(yy)
            x0 = ti.max(0, ti.cast(ti.floor(m[0] - rx + 0.5), ti.i32))
            x1 = ti.min(size[0], ti.cast(ti.floor(m[0] + rx + 0.5), ti.i32))
            y0 = ti.max(0, ti.cast(ti.floor(m[1] - ry + 0.5), ti.i32))
            y1 = ti.min(size[1], ti.cast(ti.floor(m[1] + ry + 0.5), ti.i32))
            if x0 < x1 and y0 < y1 and det > 0.0:
                depth[g] = p[2]
                mean[g] = m
                conic[g] = vec3f(yy, -xy, xx) / det
                rectangle[g, 0], rectangle[g, 1], rectangle[g, 2], rectangle[g, 3] = x0, x1, y0, y1


@ti.kernel
def count_tiles(order: ti.types.ndarray(), rectangle: ti.types.ndarray(), wide: ti.i32, count: ti.types.ndarray()):
    """Number of listed Gaussians that reach each tile; `wide` tiles in a row."""
    ti.loop_config(serialize=True)
    for i in range(order.shape[0]):
        g = order[i]
        for row in range(rectangle[g, 2] // TILE, (rectangle[g, 3] - 1) // TILE + 1):
            for column in range(rectangle[g, 0] // TILE, (rectangle[g, 1] - 1) // TILE + 1):
                count[row * wide + column] += 1


@ti.kernel
def fill_tiles(
    order: ti.types.ndarray(),
    rectangle: ti.types.ndarray(),
    wide: ti.i32,
    end: ti.types.ndarray(),
    entry: ti.types.ndarray(),
):
    """The Gaussians of each tile in the given order, nearest first; `end` advances from the start to the end of each
    tile's part."""
    ti.loop_config(serialize=True)
    for i in range(order.shape[0]):
        g = order[i]
        for row in range(rectangle[g, 2] // TILE, (rectangle[g, 3] - 1) // TILE + 1):
            for column in range(rectangle[g, 0] // TILE, (rectangle[g, 1] - 1) // TILE + 1):
                tile = row * wide + column
                entry[end[tile]] = g
                end[tile] += 1


@ti.kernel
def blend(
    start: ti.types.ndarray(),
    entry: ti.types.ndarray(),
    wide: ti.i32,
    mean: ti.types.ndarray(dtype=vec2f, ndim=1),
    conic: ti.types.ndarray(dtype=vec3f, ndim=1),
    rectangle: ti.types.ndarray(),
    opacity: ti.types.ndarray(),
    color: ti.types.ndarray(dtype=vec3f, ndim=1),
    image: ti.types.ndarray(dtype=vec3f, ndim=2),
    light: ti.types.ndarray(),
    front: ti.types.ndarray(),
    weight: ti.types.ndarray(),
):
    """Blend front to back: colour, transmitted light, the Gaussian that stops half of it, and each Gaussian's largest
    share of a pixel.

    image, light (1 at the start) and front (-1 at the start) have the shape (rows, columns), weight (0 at the start)
    one entry per Gaussian; tiles go to threads.
    """
    for task in range((start.shape[0] - 1) * LEAST):
        if task % LEAST != 0:
            continue
        tile = task // LEAST
        low_x, low_y = tile % wide * TILE, tile // wide * TILE
        high_x, high_y = ti.min(low_x + TILE, image.shape[1]), ti.min(low_y + TILE, image.shape[0])
        alive = (high_x - low_x) * (high_y - low_y)
        i = start[tile]
        while i < start[tile + 1] and alive > 0:
            g = entry[i]
            i += 1
            m, c, a, shade = mean[g], conic[g], opacity[g], color[g]
            share = 0.0
            for y in range(ti.max(low_y, rectangle[g, 2]), ti.min(high_y, rectangle[g, 3])):
                dy = y + 0.5 - m[1]
                for x in range(ti.max(low_x, rectangle[g, 0]), ti.min(high_x, rectangle[g, 1])):
                    passed = light[y, x]
                    if passed > SPENT:
                        dx = x + 0.5 - m[0]
                        alpha = ti.min(SOLID, a * ti.exp(-0.5 * (c[0] * dx * dx + c[2] * dy * dy) - c[1] * dx * dy))
                        if alpha > FAINT:
                            image[y, x] += passed * alpha * shade
                            share = ti.max(share, passed * alpha)
                            left = passed * (1.0 - alpha)
                            light[y, x] = left
                            if passed >= 0.5 > left:
                                front[y, x] = g
                            if left <= SPENT:
                                alive -= 1
            if share > 0.0:
                ti.atomic_max(weight[g], ti.cast(share, ti.f32))  # the same whichever tile comes first


@ti.kernel
def cross_level(
    origin: ti.types.ndarray(dtype=vec3f, ndim=1),
    owner: ti.types.ndarray(),
    direction: ti.types.ndarray(dtype=vec3f, ndim=1),
    distance: ti.types.ndarray(),
    position: ti.types.ndarray(dtype=vec3f, ndim=1),
    whiten: ti.types.ndarray(dtype=mat3f, ndim=1),
    opacity: ti.types.ndarray(),
    neighbour: ti.types.ndarray(),
    level: ti.f32,
    reach: ti.f32,
    samples: ti.i32,
    found: ti.types.ndarray(),
    point: ti.types.ndarray(dtype=vec3f, ndim=1),
    normal: ti.types.ndarray(dtype=vec3f, ndim=1),
):
    """First crossing of each ray into the level set of the density around the Gaussian that it meets [G24, Sec. 4.2].

    The density is sum_k a_k exp(-|W_k (p - m_k)|^2 / 2) over the owner's neighbours, W = 1 / scale times the axes
    transposed. Samples lie within `reach` of the owner's deviations along the ray around `distance`; between two of
    them the crossing is linear. The normal is opposite to the density's gradient.
    """
    for r in range(owner.shape[0]):
        g, d = owner[r], direction[r]
        found[r] = 0
        deviation = 1.0 / (whiten[g] @ d).norm()
        middle = distance[r]
        before, at_before = 0.0, 0.0
        s = 0
        while s < samples and found[r] == 0:
            t = middle + reach * deviation * (2.0 * s / (samples - 1) - 1.0)
            p = origin[r] + t * d
            total = 0.0
            for k in range(neighbour.shape[1]):
                n = neighbour[g, k]
                total += opacity[n] * ti.exp(-0.5 * (whiten[n] @ (p - position[n])).norm_sqr())
            if total >= level:
                if s == 0:
                    s = samples  # already inside: another ray sees this place better
                else:
                    t = at_before + (t - at_before) * (level - before) / (total - before)
                    p = origin[r] + t * d
                    slope = vec3f(0.0)
                    for k in range(neighbour.shape[1]):
                        n = neighbour[g, k]
                        q = whiten[n] @ (p - position[n])
                        slope += opacity[n] * ti.exp(-0.5 * q.norm_sqr()) * (whiten[n].transpose() @ q)
                    if slope.norm() > 0.0:
                        found[r] = 1
                        point[r] = p
                        normal[r] = slope.normalized()
            before, at_before = total, t
            s += 1


@ti.kernel
def settle_on_ridge(
    owner: ti.types.ndarray(),
    position: ti.types.ndarray(dtype=vec3f, ndim=1),
    axes: ti.types.ndarray(dtype=mat3f, ndim=1),
    scale: ti.types.ndarray(dtype=vec3f, ndim=1),
    opacity: ti.types.ndarray(),
    neighbour: ti.types.ndarray(),
    blur: ti.types.ndarray(),
    rounds: ti.i32,
    found: ti.types.ndarray(),
    point: ti.types.ndarray(dtype=vec3f, ndim=1),
    normal: ti.types.ndarray(dtype=vec3f, ndim=1),
):
    """Move each point along its normal to the maximum of the density, and turn the normal towards the direction in
    which the Gaussians there are thinnest: mean shift restricted to a line [O11].

    [O11] takes the line from the Hessian of the logarithm; here it is the first eigenvector of the mean of the A_k,
    which the Gaussians' own axes determine more reliably. With A_k the inverse of a neighbour's covariance plus the
    owner's blur^2 and w_k = a_k exp(-(p - m_k)^T A_k (p - m_k) / 2): p <- p + n (sum_k w_k n^T A_k (m_k - p)) / (sum_k
    w_k n^T A_k n); n <- sum_k w_k A_k n, normalised: a step of the power iteration, which never changes sides.
    """
    for r in range(owner.shape[0]):
        if found[r] == 0:
            continue
        g, p, n = owner[r], point[r], normal[r]
        thick = blur[g] * blur[g]
        for _ in range(rounds):
            turned, pull, stiff = vec3f(0.0), 0.0, 0.0
            for k in range(neighbour.shape[1]):
                i = neighbour[g, k]
                variance = scale[i] * scale[i] + thick
                along = axes[i].transpose() @ n / variance
                away = axes[i].transpose() @ (position[i] - p)
                w = opacity[i] * ti.exp(-0.5 * (away * away / variance).sum())
                turned += w * (axes[i] @ along)
                pull += w * along.dot(away)
                stiff += w * along.dot(axes[i].transpose() @ n)
            if stiff > 0.0:
                p += pull / stiff * n
                n = turned.normalized()
        point[r], normal[r] = p, n
