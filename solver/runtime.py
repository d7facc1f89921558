"""The one place that starts Taichi: once per process, because a second start kills every field and array made
before.

Kernels take numpy arrays, so the same ones run on the processor and on a graphics card, where Taichi copies the arrays
there and back at every call. Compilers differ, so results may differ in their last digits.
"""

import contextlib
import subprocess
import sys
from functools import cache

import taichi as ti
from taichi.lang.ast.ast_transformer_utils import ASTTransformerContext

from solver.errors import ArchError

LONGEST_PROBE = 120.0  # [s] for a driver that hangs; a healthy one takes a few
PROBE = """
import taichi as ti
ti.init(arch=ti.cuda, enable_fallback=False, offline_cache=False)
array = ti.ndarray(ti.f64, 8)
array.fill(1.0)
raise SystemExit(ti.lang.impl.current_cfg().arch != ti.cuda or array.to_numpy().sum() != 8.0)
"""

_started: dict[str, str] = {}


def available_arch(wanted: str) -> str:
    """What `auto`, `cpu` or `cuda` stands for on this machine: `cpu` or `cuda`; auto is cuda where Taichi can start it.

    Raises ArchError for cuda where it cannot: nothing is replaced silently.
    """
    if wanted == "cpu" or (wanted == "auto" and not cuda_starts()):
        return "cpu"
    if not cuda_starts():
        raise ArchError("cuda: Taichi cannot start CUDA here (no driver or no working graphics card); use cpu or auto")
    return "cuda"


@cache
def cuda_starts() -> bool:
    """Whether Taichi can start CUDA and run something, tried in a process of its own: a failed start spoils one."""
    ti.set_logging_level(ti.ERROR)  # that there is no driver is an answer, not worth a warning
    if not ti._lib.core.with_cuda():
        return False
    try:
        done = subprocess.run([sys.executable, "-c", PROBE], capture_output=True, check=False, timeout=LONGEST_PROBE)
    except subprocess.TimeoutExpired:
        return False
    return done.returncode == 0


def start(threads: int = 0, arch: str = "cpu") -> None:
    """Start Taichi on `arch`, `cpu` with `threads` worker threads (0: all cores) or `cuda`; later calls in the same
    process do nothing.

    Raises ArchError where CUDA cannot be started, and where this process runs on another arch already.
    """
    if _started:
        if _started["arch"] != arch:
            raise ArchError(f"{arch}: this process runs on {_started['arch']} already; start a new one")
        return
    available_arch(arch)
    # the source line of every node of every kernel, formatted for messages of Taichi's compiler: a second per process
    ASTTransformerContext.get_pos_info = lambda self, node: ""
    options = {"cpu_max_num_threads": threads} if threads > 0 and arch == "cpu" else {}
    wanted = {"cpu": ti.cpu, "cuda": ti.cuda}[arch]
    try:
        with contextlib.redirect_stdout(sys.stderr):  # it greets on standard output, which belongs to results
            ti.init(
                arch=wanted,
                enable_fallback=False,
                default_fp=ti.f64,
                default_ip=ti.i32,
                offline_cache=True,
                log_level=ti.ERROR,
                verbose=False,
                **options,
            )
    except RuntimeError as error:
        raise ArchError(f"{arch}: Taichi cannot start it: {error}") from error
    if ti.lang.impl.current_cfg().arch != wanted:
        raise ArchError(f"{arch}: TI_ARCH in the environment names another one and Taichi follows it; unset it")
    _started["arch"] = arch
