"""Where our own packages come from, whatever else bears their names.

`flows`, `tasks` and `solver` are plain words: a working directory may hold files of that name, and it leads `sys.path`
in a notebook and in `python -m`. So `import dcap` resolves exactly these names to the folders beside `dcap`, and
processes that we start take nothing from the working directory.
"""

import sys
import time
from collections.abc import Sequence
from importlib.machinery import ModuleSpec, PathFinder
from pathlib import Path
from types import ModuleType

LOADED_NS = time.time_ns()
"""When this program began to load our code: `dcap` imports this module first."""
ROOT = Path(__file__).resolve().parents[1]
"""The folder that our packages lie in: the clone, or site-packages."""
COMPANIONS = ("flows", "solver", "tasks")
"""Packages beside `dcap` that belong to it."""
LAUNCHER = Path(__file__).with_name("run_module.py")


class CompanionFinder:
    """Finds the companions beside `dcap` and nothing else."""

    @staticmethod
    def find_spec(name: str, path: Sequence[str] | None = None, target: ModuleType | None = None) -> ModuleSpec | None:
        """Where a top-level import comes from, None for whatever is not ours."""
        return PathFinder.find_spec(name, [str(ROOT)]) if name in COMPANIONS else None


def claim_companions() -> None:
    """Let the companions be found first; ImportError where a foreign module has one of their names already."""
    for name in COMPANIONS:
        module = sys.modules.get(name)
        if module is not None and not is_ours(name, module):
            raise ImportError(
                f"dcap has a package {name!r} of its own, but another one is imported already, from {places(module)}; "
                "import dcap before it, or give it another name",
                name=name,
            )
    if not any(getattr(finder, "__name__", "") == CompanionFinder.__name__ for finder in sys.meta_path):
        sys.meta_path.insert(0, CompanionFinder)


def is_ours(name: str, module: ModuleType) -> bool:
    """Whether an imported module is the package beside `dcap`."""
    return any(Path(place).resolve().is_relative_to(ROOT / name) for place in places(module))


def places(module: ModuleType) -> list[str]:
    """Files and folders that a module was imported from."""
    return [str(place) for place in (getattr(module, "__file__", None), *getattr(module, "__path__", ())) if place]


def module_command(module: str, *arguments: str, python: str = sys.executable) -> list[str]:
    """The command that runs a module as a program of its own: our packages from our folder, others as installed.

    `-P` keeps the working directory off `sys.path`; nothing is put ahead of the standard library.
    """
    return [python, "-P", str(LAUNCHER), module, *arguments]
