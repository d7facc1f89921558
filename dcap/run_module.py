"""Runs a module as a program: `python -P dcap/run_module.py MODULE ARGUMENT...`, as dcap.packages.module_command asks.

`dcap` is loaded from the folder of this file, and finds its companions beside it; this folder's parent comes last on
`sys.path`, because it may be site-packages, which must not lead the standard library.
"""

import runpy
import sys
from importlib.util import module_from_spec, spec_from_file_location
from pathlib import Path


def load_dcap() -> None:
    """Import the package `dcap` that this file belongs to, wherever `sys.path` would find one."""
    folder = Path(__file__).resolve().parent
    spec = spec_from_file_location("dcap", folder / "__init__.py", submodule_search_locations=[str(folder)])
    assert spec is not None
    assert spec.loader is not None
    sys.modules["dcap"] = module_from_spec(spec)
    spec.loader.exec_module(sys.modules["dcap"])
    sys.path.append(str(folder.parent))


if __name__ == "__main__":
    load_dcap()
    runpy.run_module(sys.argv.pop(1), run_name="__main__", alter_sys=True)
