"""A reference drop in Genesis: MPM slab, rigid ball, its own coupler.

python -m perf.peers.genesis_drop YOUNGS_MODULUS DEVICE LIMIT_SECONDS     docs/peers.md says why these settings
"""

import sys
import time
from importlib.metadata import version

import genesis as gs

from perf.peers import reference as ref

CELLS_PER_METRE = 64
"""Genesis' default: cells of 15.6 mm, particles 10 mm apart."""
PARTICLE = 0.64 / CELLS_PER_METRE
"""Distance of particles [m], by Genesis' default rule."""
STEP = 2e-3
"""Scene step [s]."""
SUBSTEPS = {2e4: 10, 5e5: 20}
"""Substeps of 0.2 and 0.1 ms: Genesis suggests at most 0.02 cells per metre (0.31 ms); waves cross 0.4 of a cell in 0.5
and 0.1 ms."""


def main() -> None:
    """Drop and report."""
    modulus, device, limit = float(sys.argv[1]), sys.argv[2], float(sys.argv[3])
    begin = time.perf_counter()
    gs.init(backend=gs.cuda if device == "cuda" else gs.cpu, logging_level="warning")
    cell, (width, depth, height) = 1 / CELLS_PER_METRE, ref.SLAB
    room = 5 * cell  # three cells are padding of the domain, two are air
    scene = gs.Scene(
        sim_options=gs.options.SimOptions(dt=STEP, substeps=SUBSTEPS[modulus], gravity=(0, 0, -ref.GRAVITY)),
        mpm_options=gs.options.MPMOptions(
            grid_density=CELLS_PER_METRE,
            gravity=(0, 0, 0),
            lower_bound=(-width / 2 - room, -depth / 2 - room, -room),
            upper_bound=(width / 2 + room, depth / 2 + room, height + room),
        ),
        show_viewer=False,
    )
    slab = scene.add_entity(
        gs.morphs.Box(pos=(0, 0, height / 2), size=ref.SLAB),
        material=gs.materials.MPM.Elastic(E=modulus, nu=ref.POISSON, rho=ref.DENSITY, sampler="regular"),
    )
    ball = scene.add_entity(
        gs.morphs.Sphere(pos=(0, 0, height + ref.RADIUS + ref.START), radius=ref.RADIUS),
        material=gs.materials.Rigid(rho=ref.BALL_DENSITY, coup_friction=ref.FRICTION),
    )
    scene.build()
    free = slab.get_particles_pos().reshape(-1, 3)[:, 2] > PARTICLE  # all but the lowest layer
    slab.set_free(free)
    scene.step()  # compiles what build() did not
    scene.reset()
    slab.set_free(free)
    prepare = time.perf_counter() - begin

    def advance() -> float:
        count = round(ref.LOOK_SECONDS / STEP)
        for _ in range(count):
            scene.step()
        return count * STEP

    def look() -> tuple[float, float]:
        fastest = max(float(slab.get_particles_vel().reshape(-1, 3).norm(dim=1).max()), float(ball.get_vel().norm()))
        return float(ball.get_pos().reshape(-1)[2]), fastest

    fall = ref.follow(advance, look, limit)
    ref.report(
        ref.PeerDrop(
            versions=f"genesis-world {version('genesis-world')}, quadrants {version('quadrants')}",
            device=device,
            elements=f"{slab.n_particles:,} particles",
            cell=cell,
            step=STEP / SUBSTEPS[modulus],
            prepare=prepare,
            **vars(fall),
        )
    )


if __name__ == "__main__":
    main()
