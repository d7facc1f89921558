"""A reference drop in Newton: slab of tetrahedra and rigid ball, both moved by SolverVBD.

python -m perf.peers.newton_drop YOUNGS_MODULUS DEVICE LIMIT_SECONDS     docs/peers.md says why these settings
"""

import sys
import time
from importlib.metadata import version

import newton
import numpy as np
import warp as wp

from perf.peers import reference as ref
from perf.peers.tets import slab

CELL = {2e4: 4e-3, 5e5: 1.5e-3}
"""Smallest cell [m], at the contact: the same as for dcap's own grids."""
GROWTH = {2e4: 1.2, 5e5: 1.25}
"""Growth from cell to cell away from the contact [-]."""
STEP = 1 / 600
"""Time step [s] of Newton's soft-body examples: 60 frames of 10 substeps."""
ITERATIONS = 10
"""Sweeps per step: Newton's default."""
DAMPING = {2e4: 500.0, 5e5: 5000.0}
"""Viscosity [Pa s]: about critical for the ball's bounce, E / omega with omega = 35 and 99 per second, as dcap does."""
CONTACT = 2e4
"""Contact stiffness of a node [N/m]: the ball sinks into the surface by about 1e-5 m."""
GAP = 0.01
"""Distance within which contacts are searched [m]."""
THIN = 1e-6
"""Radius of the slab's nodes in contact [m]: they represent a surface."""


def main() -> None:
    """Drop and report."""
    modulus, device, limit = float(sys.argv[1]), sys.argv[2], float(sys.argv[3])
    begin = time.perf_counter()
    wp.config.quiet = True
    wp.set_device("cuda:0" if device == "cuda" else "cpu")
    nodes, tets = slab(CELL[modulus], GROWTH[modulus])
    builder = newton.ModelBuilder(gravity=(0.0, 0.0, 0.0))  # the slab is weightless; the ball's weight is a force on it
    builder.add_soft_mesh(
        pos=(0.0, 0.0, 0.0),
        rot=wp.quat_identity(),
        scale=1.0,
        vel=(0.0, 0.0, 0.0),
        vertices=nodes.tolist(),
        indices=tets.ravel().tolist(),
        density=ref.DENSITY,
        k_mu=modulus / (2 * (1 + ref.POISSON)),
        k_lambda=modulus * ref.POISSON / ((1 + ref.POISSON) * (1 - 2 * ref.POISSON)),
        k_damp=DAMPING[modulus],
        particle_radius=THIN,
    )
    for node in np.flatnonzero(nodes[:, 2] == 0.0):
        builder.particle_mass[node] = 0.0
        builder.particle_flags[node] &= ~int(newton.ParticleFlags.ACTIVE)
    place = wp.transform(wp.vec3(0.0, 0.0, ref.SLAB[2] + ref.RADIUS + ref.START), wp.quat_identity())
    ball = builder.add_body(xform=place)
    touch = newton.ModelBuilder.ShapeConfig(density=ref.BALL_DENSITY, ke=CONTACT, kd=0.0, mu=ref.FRICTION)
    builder.add_shape_sphere(ball, radius=ref.RADIUS, cfg=touch)
    builder.color()
    model = builder.finalize()
    model.soft_contact_ke, model.soft_contact_kd, model.soft_contact_mu = CONTACT, 0.0, ref.FRICTION
    pipeline = newton.CollisionPipeline(model, soft_contact_gap=GAP)
    contacts, control = pipeline.contacts(), model.control()

    def solver() -> newton.solvers.SolverVBD:
        return newton.solvers.SolverVBD(
            model,
            iterations=ITERATIONS,
            particle_enable_self_contact=False,
            particle_enable_tile_solve=device == "cuda",  # tiles are for graphics cards
            rigid_body_particle_contact_buffer_size=8192,
        )

    weight = wp.array([wp.spatial_vector(0.0, 0.0, -ref.MASS * ref.GRAVITY, 0.0, 0.0, 0.0)], dtype=wp.spatial_vector)
    states, vbd = [model.state(), model.state()], solver()

    def advance() -> float:
        count = round(ref.LOOK_SECONDS / STEP)
        for _ in range(count):
            states[0].clear_forces()
            wp.copy(states[0].body_f, weight)
            pipeline.collide(states[0], contacts)
            vbd.step(states[0], states[1], control, contacts, STEP)
            states.reverse()
        return count * STEP

    def look() -> tuple[float, float]:
        velocity = np.concatenate([states[0].particle_qd.numpy(), states[0].body_qd.numpy()[:, :3]])
        return float(states[0].body_q.numpy()[0, 2]), float(np.linalg.norm(velocity, axis=1).max())

    advance()  # compiles
    look()
    states[:], vbd = [model.state(), model.state()], solver()  # a solver stores earlier positions of bodies
    prepare = time.perf_counter() - begin
    fall = ref.follow(advance, look, limit)
    ref.report(
        ref.PeerDrop(
            versions=f"newton {version('newton')}, warp-lang {version('warp-lang')}",
            device=device,
            elements=f"{len(nodes):,} nodes, {len(tets):,} tetrahedra",
            cell=CELL[modulus],
            step=STEP,
            prepare=prepare,
            **vars(fall),
        )
    )


if __name__ == "__main__":
    main()
