"""Starts Taichi, only here and once per process, because a second start destroys all existing fields and arrays.

Kernels take numpy arrays, so the same kernels run on the processor and on a graphics card, where Taichi copies the
arrays there and back at every call. Compilers differ, so results may differ in their last digits.
"""

import contextlib
import io
import os
import subprocess
import sys
from functools import cache
from pathlib import Path

import taichi as ti
from taichi.lang.ast.ast_transformer_utils import ASTTransformerContext

from solver.errors import ArchError

LONGEST_PROBE = 300.0  # [s] limit for a driver that hangs; compiling the kernels takes a minute
PROBE = """
import sys
from solver import runtime
from solver.config import SolverConfig
from solver.warmup import drop_little
runtime.cuda_works = lambda: True
for method in ("tl", "mls"):
    drop_little(SolverConfig(arch=sys.argv[1], method=method, threads=1), soft=True)
"""

_started: dict[str, str] = {}


def available_arch(wanted: str) -> str:
    """Resolve `auto`, `cpu` or `cuda` to `cpu` or `cuda` on this machine; auto means cuda if it works.

    Raises ArchError for cuda if it does not work: nothing is replaced silently.
    """
    if wanted == "cpu" or (wanted == "auto" and not cuda_works()):
        return "cpu"
    if not cuda_works():
        raise ArchError(
            "cuda: Taichi cannot run the solver's kernels here (no driver, no working graphics card, or one on which "
            "they break); use cpu or auto"
        )
    return "cuda"


@cache
def cuda_works() -> bool:
    """Return whether the solver's kernels run on a graphics card: Taichi may start there and fail in them."""
    ti.set_logging_level(ti.ERROR)  # a missing driver is an expected answer, not worth a warning
    return bool(ti._lib.core.with_cuda()) and kernels_run("cuda")


def kernels_run(arch: str) -> bool:
    """Return whether a small drop by each method runs on `arch`, tested in its own process because a failed start
    breaks it."""
    command = [sys.executable, "-P", "-c", PROBE, arch]
    try:
        done = subprocess.run(command, capture_output=True, check=False, timeout=LONGEST_PROBE)
    except subprocess.TimeoutExpired:
        return False
    return done.returncode == 0


def start(threads: int = 0, arch: str = "cpu") -> None:
    """Start Taichi on `arch`, `cpu` with `threads` worker threads (0: all cores) or `cuda`; later calls in the same
    process do nothing.

    Raises ArchError if CUDA cannot be started, or if this process already runs on another arch.
    """
    if _started:
        if _started["arch"] != arch:
            raise ArchError(f"{arch}: this process runs on {_started['arch']} already; start a new one")
        return
    available_arch(arch)
    # Taichi formats the source line of every node of every kernel for compiler messages: a second per process
    ASTTransformerContext.get_pos_info = lambda self, node: ""
    cores = available_cores()
    workers = (threads or len(cores)) if arch == "cpu" else 1
    earlier = _thread_ids()
    wanted = {"cpu": ti.cpu, "cuda": ti.cuda}[arch]
    try:
        with contextlib.redirect_stdout(io.StringIO()):  # Taichi's greeting would appear among the results
            ti.init(
                arch=wanted,
                enable_fallback=False,
                default_fp=ti.f64,
                default_ip=ti.i32,
                offline_cache=True,
                log_level=ti.ERROR,
                verbose=False,
                cpu_max_num_threads=workers,
            )
    except RuntimeError as error:
        raise ArchError(f"{arch}: Taichi cannot start it: {error}") from error
    if ti.lang.impl.current_cfg().arch != wanted:
        raise ArchError(f"{arch}: TI_ARCH in the environment selects another one; unset it")
    _started["arch"] = arch
    if workers == len(cores) > 1:
        _pin_threads(_thread_ids() - earlier, cores)


def available_cores() -> list[int]:
    """Numbers of the cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return sorted(os.sched_getaffinity(0))
    return list(range(os.cpu_count() or 1))


def _thread_ids() -> set[int]:
    tasks = Path("/proc/self/task")
    return {int(t.name) for t in tasks.iterdir()} if tasks.is_dir() else set()


def _pin_threads(threads: set[int], cores: list[int]) -> None:
    """Pin each thread to its own core if there are enough cores.

    A kernel here takes about a millisecond. A scheduler that wakes two workers on one core and separates them later
    makes two cores no faster than one: on a virtual machine that packs its cores, kernels of 3 ms took 6."""
    for k, thread in enumerate(sorted(threads)):
        with contextlib.suppress(OSError):  # a thread that has ended, or a system that does not allow it
            os.sched_setaffinity(thread, {cores[k % len(cores)]})
