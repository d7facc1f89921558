"""A run says what it is computed with."""

import platform
from importlib.metadata import version as installed

from dcap.scene.settings import version
from flows.benchmark import versions


def test_versions_are_those_that_run() -> None:
    """Ours, Python's, and those of installed libraries; none is empty."""
    found = versions()
    assert found["dcap"] == version()
    assert found["python"] == platform.python_version()
    assert found["numpy"] == installed("numpy")
    assert all(found.values())
