"""Times and memory of whole drops and of the method mls; each drop in a process of its own.

python -m perf.drops CASE OUT     one drop, as JSON on standard output
"""

import json
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq

from dcap.geometry.primitives import Box
from dcap.packages import module_command
from perf.peers.reference import DEPTH
from solver.mls.body import SoftParticles
from solver.model import soft as soft_system
from solver.model.bodies import Interior, Model, SignedDistance, SoftBody
from solver.runtime import start
from tasks.case.run import run_case

CELLS = (1e-2, 5e-3, 3.5e-3, 2e-3, 1.3e-3)
"""Resolutions [m] at which the softer reference drop has 10 thousand to a million particles."""
MPM_SIDE = 150
"""Particles along the long sides of the block that mls moves: a million in all."""


def case_of(size: tuple[float, float, float], foam: dict[str, float], ball: dict[str, float], **more: object) -> str:
    """A ball 1 cm above a fixed slab."""
    friction = {"poisson_ratio": 0.3, "static_friction": 0.5, "dynamic_friction": 0.4}
    slab = {"name": "slab", "shape": {"box": {"size": list(size)}}, "position": [0, 0, size[2] / 2], "motion": "fixed",
            "material": foam | friction}  # fmt: skip
    height = size[2] + ball["radius"] + 0.01
    body = {"name": "ball", "shape": {"sphere": {"radius": ball["radius"]}}, "position": [0, 0, height],
            "mass": ball["mass"], "material": "steel"}  # fmt: skip
    return json.dumps({"bodies": [slab, body]} | more)


def reference(modulus: float, **more: object) -> str:
    """The reference drop."""
    return case_of((0.4, 0.4, 0.15), {"density": 200, "youngs_modulus": modulus}, {"radius": 0.05, "mass": 1.0}, **more)


def mattress(width: float, depth: float) -> str:
    """A 5 kg ball on a mattress, 8 mm at the contact."""
    foam = {"density": 60, "youngs_modulus": 5e4}
    return case_of((width, depth, 0.25), foam, {"radius": 0.12, "mass": 5.0}, resolution=8e-3)


def rolling() -> str:
    """A soft ball thrown along a slab: soft on soft, with friction, over many steps."""
    case = json.loads(case_of((0.8, 0.4, 0.1), {"density": 60, "youngs_modulus": 3e4}, {"radius": 0.1, "mass": 0.4}))
    slab, ball = case["bodies"]
    soft = {"density": 95, "youngs_modulus": 1e5, "rolling_resistance": 2e-3}
    ball |= {"material": slab["material"] | soft, "position": [-0.25, 0.0, 0.205], "velocity": [0.4, 0.0, 0.0]}
    return json.dumps(case)


def measured(case: str) -> dict[str, float]:
    """Depth, steps, wall time and peak memory of a drop in a fresh process."""
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "case.yaml"
        path.write_text(case, encoding="utf-8")
        command = module_command("perf.drops", str(path), str(Path(folder) / "out"))
        output = subprocess.run(command, check=True, capture_output=True, text=True).stdout
    return dict(json.loads(output))


def drop_rows() -> tuple[list[tuple[str, ...]], str]:
    """(name, particles, steps, Newton and linear iterations, wall, per particle and step, memory, depth, wall over the
    first) of every drop, and a line on memory from the drops of one case at all its resolutions."""
    cases: dict[str, tuple[str, float | None]] = {
        "ball on foam, E 5e5": (reference(5e5), DEPTH[5e5]),
        "ball on foam, E 2e4": (reference(2e4), DEPTH[2e4]),
        "mattress, whole": (mattress(2.0, 1.6), None),
        "mattress, cut out": (mattress(0.6, 0.6), None),
        "soft ball rolls on foam": (rolling(), None),
    }
    scaled = {f"E 2e4, cells of {1e3 * h:.1f} mm": (reference(2e4, resolution=h), DEPTH[2e4]) for h in CELLS}
    results = {name: measured(case) for name, (case, _) in (cases | scaled).items()}
    first = next(iter(results.values()))["wall_s"]
    rows: list[tuple[str, ...]] = []
    for name, (_, depth) in (cases | scaled).items():
        one = results[name]
        error = f"{100 * (one['depth'] / depth - 1):+.1f} %" if depth else f"{1e3 * one['depth']:.1f} mm"
        per = 1e9 * one["wall_s"] / (one["particles"] * one["steps"])
        rows.append(
            (name, f"{one['particles']:,.0f}", f"{one['steps']:.0f}", f"{one['newton']:.0f}",
             f"{one['linear']:.0f}", f"{one['wall_s']:.1f} s", f"{per:.0f} ns",
             f"{one['memory'] / 2**20:.0f} MiB", error, f"{one['wall_s'] / first:.2f}")
        )  # fmt: skip
    particles, memory = (np.array([results[name][key] for name in scaled]) for key in ("particles", "memory"))
    slope, start_up = np.polyfit(particles, memory, 1)
    return (
        rows,
        f"memory: {start_up / 2**20:.0f} MiB and {slope:.0f} bytes a particle (fit over the last {len(scaled)})",
    )


def mls_speed() -> float:
    """Particle-steps per second of mls's two transfers on a block of a million particles, strained by 2 %: the best of
    a few runs."""
    start()
    cell, random = 0.01, np.random.default_rng(0)
    across, deep = (cell * np.arange(count // 2 + 1, dtype=np.float64) for count in (MPM_SIDE, MPM_SIDE // 3))
    planes = across, across, deep
    points = [0.5 * cell * (np.arange(2 * (len(p) - 1)) + 0.5) for p in planes]
    x = np.stack(np.meshgrid(*points, indexing="ij"), axis=-1).reshape(-1, 3)
    one = np.ones(len(x))
    interior = Interior(
        x, one * (0.5 * cell) ** 3, 200.0 * one, 2.6e4 * one, 0.3 * one, planes,
        np.zeros(tuple(len(p) for p in planes), np.int8), loaded=False,
    )  # fmt: skip
    box = Box(np.array([p[-1] for p in planes])).surface(0.1)
    distance = SignedDistance(np.zeros(3), 0.1, np.ones((3, 3, 3), np.float32))
    mass = float(interior.volume @ interior.density)
    body = SoftBody("block", False, box.vertices - box.bounds[0], box.faces, distance, mass, x.mean(axis=0), 0.5, 0.4,
                    0.0, interior)  # fmt: skip
    gravity = np.array([0.0, 0.0, -9.81])
    system = soft_system.build(Model((body,), gravity))
    block = SoftParticles(0, body, system, system.bodies[0], 1e-9)
    block.F += 0.02 * random.normal(size=block.F.shape)
    count = len(x)

    def step() -> None:
        block.step(1e-6, gravity)

    step()
    steps, times = 5, []
    for _ in range(4):
        begin = time.perf_counter()
        for _ in range(steps):
            step()
        times.append(time.perf_counter() - begin)
    return count * steps / min(times)


def main() -> None:
    """Run one case and print its costs."""
    result = run_case(Path(sys.argv[1]), Path(sys.argv[2]), quiet=True)
    bodies = result["bodies"]
    assert isinstance(bodies, dict)
    top = json.loads(Path(sys.argv[1]).read_bytes())["bodies"][0]["shape"]["box"]["size"][2]
    history = pq.read_table(Path(sys.argv[2]) / "history.parquet", columns=["newton", "linear"]).to_pydict()
    kept = {key: result[key] for key in ("wall_s", "particles", "steps")} | {k: sum(v) for k, v in history.items()}
    memory = 1024 * resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    sys.stdout.write(json.dumps(kept | {"depth": top - bodies["ball"]["aabb"][0][2], "memory": memory}))


if __name__ == "__main__":
    main()
