"""Imports of heavy libraries without what they print in a notebook."""

import os
import sys
import threading
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager, redirect_stdout

NO_VIEWER = "OPEN3D_DISABLE_WEB_VISUALIZER"
"""Open3D starts a server for pictures in pages when it is imported in a notebook, and says so."""
_lock, _inside, _before = threading.Lock(), list[None](), ExitStack()


@contextmanager
def quiet_imports() -> Iterator[None]:
    """Let libraries be imported in this block as in a program without a notebook.

    Taichi looks once, at import, whether standard output has been replaced; if so, it says so and asks each kernel what
    it has printed.
    """
    with _lock:
        if not _inside:
            _before.enter_context(_quiet())
        _inside.append(None)
    try:
        yield
    finally:
        with _lock:  # the last thread that leaves puts back what the first has found
            _inside.pop()
            if not _inside:
                _before.close()


@contextmanager
def _quiet() -> Iterator[None]:
    """Do that for the whole process."""
    before = os.environ.get(NO_VIEWER)
    os.environ[NO_VIEWER] = "true"
    try:
        with redirect_stdout(sys.__stdout__):
            yield
    finally:
        if before is None:
            del os.environ[NO_VIEWER]
        else:
            os.environ[NO_VIEWER] = before
