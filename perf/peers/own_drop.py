"""A reference drop in dcap: `dcap drop` twice in one process, the second of which is measured.

python -m perf.peers.own_drop YOUNGS_MODULUS METHOD
"""

import json
import sys
import tempfile
import time
from importlib.metadata import version
from pathlib import Path

from perf.drops import reference
from perf.peers import reference as ref
from tasks.case.run import run_case


def main() -> None:
    """Drop and report."""
    modulus, method = float(sys.argv[1]), sys.argv[2]
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "case.yaml"
        path.write_text(reference(modulus), encoding="utf-8")
        begin = time.perf_counter()
        run_case(path, Path(folder), solver=method, quiet=True)
        prepare, begin_cpu = time.perf_counter() - begin, time.process_time()
        result = json.loads(json.dumps(run_case(path, Path(folder), solver=method, quiet=True)))
        cpu = time.process_time() - begin_cpu
    bodies = result["bodies"]
    steps = result["certificate"].get("substeps", result["steps"])  # mls counts the intervals between its tests of rest
    ref.report(
        ref.PeerDrop(
            versions=f"dcap {version('dcap')}, taichi {version('taichi')}",
            device="cpu",
            elements=f"{result['particles']:,} particles",
            cell=result["resolution"],
            step=result["simulated_s"] / steps,
            depth=ref.SLAB[2] - bodies["ball"]["aabb"][0][2],
            speed=max(body["max_speed"] for body in bodies.values()),
            at_rest=result["verdict"] == "at_rest",
            simulated=result["simulated_s"],
            wall=result["wall_s"],
            cpu=cpu,
            prepare=prepare,
        )
    )


if __name__ == "__main__":
    main()
