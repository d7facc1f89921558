"""Imports of heavy libraries without what they print in a notebook."""

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager, redirect_stdout

from dcap.shared_context import SharedContext

NO_VIEWER = "OPEN3D_DISABLE_WEB_VISUALIZER"
"""Open3D starts a server for pictures in pages when it is imported in a notebook, and says so."""


@contextmanager
def _quiet() -> Iterator[None]:
    """Let libraries be imported in this block as in a program without a notebook.

    Taichi looks once, at import, whether standard output has been replaced; if so, it says so and asks each kernel what
    it has printed.
    """
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


quiet_imports = SharedContext(_quiet)
