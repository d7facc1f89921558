"""Where the kernels run: what was asked for or an error, never a silent replacement."""

import json
import os
import subprocess
import sys

import pytest

from solver import runtime
from solver.errors import ArchError
from solver.runtime import available_arch, kernels_run, start

CORES_OF_THREADS = """
import json, os, sys
from solver.runtime import start

start(int(sys.argv[1]))
found = []
for thread in map(int, os.listdir("/proc/self/task")):
    try:
        found.append([thread == os.getpid(), sorted(os.sched_getaffinity(thread))])
    except ProcessLookupError:
        pass  # a thread that has ended since
print(json.dumps(found))
"""


@pytest.mark.parametrize(
    ("wanted", "cuda", "found"), [("auto", True, "cuda"), ("auto", False, "cpu"), ("cpu", True, "cpu")]
)
def test_auto_is_cuda_where_it_starts_and_the_processor_elsewhere(monkeypatch, wanted, cuda, found):
    """`cpu` stays what it is."""
    monkeypatch.setattr(runtime, "cuda_works", lambda: cuda)
    assert available_arch(wanted) == found


def test_cuda_where_there_is_none_is_an_error(monkeypatch):
    """Asked for by name it is not replaced."""
    monkeypatch.setattr(runtime, "cuda_works", lambda: False)
    with pytest.raises(ArchError, match="cuda"):
        available_arch("cuda")


@pytest.mark.slow
def test_a_try_of_the_kernels_says_whether_they_run():
    """On the processor they do. Without that answer a working graphics card would be refused as well."""
    assert kernels_run("cpu")
    assert not kernels_run("no such arch")


def test_a_second_arch_in_one_process_is_an_error():
    """Another start would kill every array of the first."""
    start(2)
    start(2)
    with pytest.raises(ArchError, match="runs on cpu already"):
        start(2, "cuda")


def test_the_environment_cannot_put_a_result_on_another_arch():
    """Taichi follows TI_ARCH; a result that says cpu must be from there."""
    command = [sys.executable, "-c", "from solver.runtime import start; start(2)"]
    done = subprocess.run(command, capture_output=True, text=True, env=os.environ | {"TI_ARCH": "vulkan"})
    assert "ArchError: cpu" in done.stderr


@pytest.mark.skipif(not hasattr(os, "sched_getaffinity"), reason="threads have no cores of their own here")
@pytest.mark.parametrize("share", [True, False])
def test_worker_threads_get_cores_of_their_own_only_where_there_is_one_for_each(share):
    """Fewer threads than cores leave them to other processes: a benchmark runs several drops side by side."""
    cores = sorted(os.sched_getaffinity(0))
    if len(cores) == 1:
        pytest.skip("one core")
    done = subprocess.run(
        [sys.executable, "-c", CORES_OF_THREADS, str(len(cores) - share)], capture_output=True, text=True, check=True
    )
    masks = json.loads(done.stdout)
    assert [mask for main, mask in masks if main] == [cores], "the main thread stays free"
    own = {mask[0] for _, mask in masks if len(mask) == 1}
    assert own == (set() if share else set(cores))
