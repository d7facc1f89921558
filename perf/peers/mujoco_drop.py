"""A reference drop in MuJoCo: the slab a flex of tetrahedra, the ball a rigid sphere, both in one constraint solve.

python -m perf.peers.mujoco_drop YOUNGS_MODULUS DEVICE LIMIT_SECONDS [CELL]     docs/peers.md says why these settings
"""

import sys
import time
from importlib.metadata import version

import mujoco
import numpy as np
from numpy.typing import NDArray

from perf.peers import reference as ref
from perf.peers.tets import lumped, slab

CELL = {2e4: 4e-3, 5e5: 1.5e-3}
"""Smallest cell [m], at the contact: the same as for dcap's own grids and for Newton."""
GROWTH = {2e4: 1.2, 5e5: 1.25}
"""Growth from cell to cell away from the contact [-]."""
STEP = {2e4: 1 / 300, 5e5: 2e-3}
"""Time step [s], out of the 1 to 4 ms that MuJoCo's manual calls typical; looks are a whole number of steps apart."""
DAMPING = {2e4: 0.05, 5e5: 0.02}
"""Rayleigh's coefficient [s]: about critical for the ball's bounce, 2 / omega with omega = 35 and 99 per second; the
manual's range ends at 0.05."""
TOLERANCE = 1e-6
"""Relative residual of the solver [-]: the manual's for flexes."""
ITERATIONS = 400
"""Upper end of the manual's range: with the default, 100, the solve of mass and stiffness warns that it ran out."""
CONTACT = {2e4: 'solref="0.004 1" solimp="0.99 0.9999 0.0001"', 5e5: 'solref="0.002 1" solimp="0.9999 0.9999 0.0001"'}
"""Time constant of contacts [s] and their impedance [-], up to the largest there is: softer ones let the ball sink in,
the more the finer the mesh, because contacts get softer as nodes get lighter."""
STABLE_NEO_HOOKEAN = 1
"""mjsFlex.elastic3d; 0, the default, is Saint Venant-Kirchhoff, into which the ball keeps sinking at E 2e4."""


def numbers(values: NDArray[np.float64] | NDArray[np.int64]) -> str:
    """An array as an attribute of MJCF."""
    return " ".join(map(repr, values.ravel().tolist()))


def scene(modulus: float, nodes: NDArray[np.float64], tets: NDArray[np.int64]) -> str:
    """MJCF of slab and ball; without gravity, because the slab is weightless and the ball's weight a force on it."""
    step = STEP[modulus]
    contact = f'friction="{ref.FRICTION}" {CONTACT[modulus]}'
    bottom = np.flatnonzero(nodes[:, 2] == 0.0)
    return f"""<mujoco>
      <option integrator="discrete" solver="CG" tolerance="{TOLERANCE}" iterations="{ITERATIONS}" timestep="{step!r}"
              gravity="0 0 0"><flag autoreset="disable"/></option>
      <worldbody>
        <body name="ball" pos="0 0 {ref.SLAB[2] + ref.RADIUS + ref.START}">
          <freejoint/><geom type="sphere" size="{ref.RADIUS}" mass="{ref.MASS}" {contact}/>
        </body>
        <flexcomp name="slab" type="direct" dim="3" radius="0" point="{numbers(nodes)}" element="{numbers(tets)}">
          <elasticity young="{modulus}" poisson="{ref.POISSON}" damping="{DAMPING[modulus]}"/>
          <contact selfcollide="none" {contact}/>
          <pin id="{numbers(bottom)}"/>
        </flexcomp>
      </worldbody>
    </mujoco>"""


def compiled(modulus: float, nodes: NDArray[np.float64], tets: NDArray[np.int64]) -> mujoco.MjModel:
    """The model of a drop."""
    spec = mujoco.MjSpec.from_string(scene(modulus, nodes, tets))
    flex = spec.flexes[0]
    flex.elastic3d = STABLE_NEO_HOOKEAN
    # flexcomp gives all nodes the same mass
    for name, mass in zip(flex.vertbody, ref.DENSITY * lumped(nodes, tets), strict=True):
        if name != "world":  # is pinned
            spec.body(name).mass = mass
    return spec.compile()


def main() -> None:
    """Drop and report."""
    modulus, device, limit = float(sys.argv[1]), sys.argv[2], float(sys.argv[3])
    cell = float(sys.argv[4]) if len(sys.argv) > 4 else CELL[modulus]
    begin = time.perf_counter()
    # else warnings go into a file of the working folder
    mujoco.set_mju_user_warning(lambda text: sys.stderr.write(f"{text}\n"))
    nodes, tets = slab(cell, GROWTH[modulus])
    model = compiled(modulus, nodes, tets)
    data = mujoco.MjData(model)
    data.xfrc_applied[model.body("ball").id, 2] = -ref.MASS * ref.GRAVITY
    count = round(ref.LOOK_SECONDS / STEP[modulus])
    prepare = time.perf_counter() - begin

    def advance() -> float:
        mujoco.mj_step(model, data, count)
        return count * STEP[modulus]

    def look() -> tuple[float, float]:
        velocity = np.concatenate([data.qvel[:3], data.qvel[6:]]).reshape(-1, 3)  # without the ball's spin
        return float(data.body("ball").xpos[2]), float(np.linalg.norm(velocity, axis=1).max())

    fall = ref.follow(advance, look, limit)
    ref.report(
        ref.PeerDrop(
            versions=f"mujoco {version('mujoco')}",
            device=device,
            elements=f"{len(nodes):,} nodes, {len(tets):,} tetrahedra",
            cell=cell,
            step=STEP[modulus],
            prepare=prepare,
            **vars(fall),
        )
    )


if __name__ == "__main__":
    main()
