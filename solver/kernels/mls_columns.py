"""Columns of the packed arrays that the kernels of mls share; vectors start at theirs and take three.

A row is one thing (a node, a particle, a body), so that a kernel reads what it needs of it in one place.
"""

import taichi as ti

from solver.kernels.elastic import vec3

# a node of the grid: velocity [m/s] (momentum before the update), then
NODE_MASS = 3  # [kg]

# a soft body's material at a node: first moment about the node [kg m], then
MATERIAL_MASS = 3  # [kg]

# constants of a particle
PARTICLE_MASS = 0  # [kg]
VOLUME_MU = 1  # rest volume times shear modulus [J]
VOLUME_LAMBDA = 2  # rest volume times first Lame parameter [J]
GRAVITY_SHARE = 3  # share of gravity that acts [-]

# side of a thin body that a node, or a particle, is on: its outward normal there, then
SIDE_MARK = 3  # number of the body, from 1; 0: none is near
SIDE_DISTANCE = 4  # signed distance of a particle from it [m], negative where it has been entered

# motion of a thin body: position of its centre [m], then
PLATE_VELOCITY = 3  # of the centre [m/s]
PLATE_SPIN = 6  # angular velocity [rad/s]

# friction of a pair
STATIC = 0
DYNAMIC = 1

# rows of a frame: where the grid and a rigid body are
GRID_LOW = 0  # position of node (0, 0, 0) [m]
CENTER = 1  # of mass [m]
START_CENTER = 2  # of mass in the start pose, in which distances are sampled [m]
SAMPLE_ORIGIN = 3  # position of sample (0, 0, 0) in the start pose [m]
ROTATION = 4  # three rows

# rows of a span, the box of nodes around a rigid body
SPAN_FIRST = 0  # first node along x, y, z
SPAN_COUNT = 1  # nodes along x, y, z

# columns of a block of particles
BLOCK_FIRST = 0  # first particle
BLOCK_END = 1  # one past the last
BLOCK_COLUMN = 2  # first column of cells of its pencil along x, then along y


@ti.func
def vector_at(array: ti.template(), row: ti.i32, first: ti.template()) -> vec3:
    """The vector that starts at a column of a row."""
    return vec3(array[row, first], array[row, first + 1], array[row, first + 2])


@ti.func
def node_in_span(s: ti.i32, span: ti.template()):
    """Indices along x, y, z of the s-th node of a span."""
    across, deep = span[SPAN_COUNT, 1], span[SPAN_COUNT, 2]
    return ti.Vector([span[SPAN_FIRST, 0] + s // (across * deep), span[SPAN_FIRST, 1] + (s // deep) % across,
                      span[SPAN_FIRST, 2] + s % deep])  # fmt: skip
