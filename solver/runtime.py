"""The one place that starts Taichi: once per process, because a second start kills every field and array made
before."""

import contextlib
import sys

import taichi as ti
from taichi.lang.ast.ast_transformer_utils import ASTTransformerContext

import solver.kernels  # noqa: F401  silences the banner that Taichi prints when imported

_started: dict[str, int] = {}


def start(threads: int = 0) -> None:
    """Start Taichi on the CPU with `threads` worker threads (0: all cores); later calls in the same process do
    nothing."""
    if _started:
        return
    # the source line of every node of every kernel, formatted for messages of Taichi's compiler: a second per process
    ASTTransformerContext.get_pos_info = lambda self, node: ""
    options = {"cpu_max_num_threads": threads} if threads > 0 else {}
    with contextlib.redirect_stdout(sys.stderr):  # it greets on standard output, which belongs to results
        ti.init(
            arch=ti.cpu,
            default_fp=ti.f64,
            default_ip=ti.i32,
            offline_cache=True,
            log_level=ti.ERROR,
            verbose=False,
            **options,
        )
    _started["threads"] = threads
