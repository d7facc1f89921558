"""What the commands share: checks of options before anything heavy is imported or computed."""

import os
from pathlib import Path
from typing import Annotated

import typer

from dcap.scene.errors import InputError

Json = Annotated[bool, typer.Option("--json", help="Print the result as JSON on standard output.")]
LARGEST_RESOLUTION_M = 1.0
"""A cell larger than this resolves nothing that can be placed in a room [m]."""
SOLVERS = ("tl", "mls")
ARCHS = ("auto", "cpu", "cuda")


def choice(option: str, value: str, allowed: tuple[str, ...]) -> str:
    """A value from a closed list."""
    if value not in allowed:
        raise InputError(f"{option} {value!r} is not one of {', '.join(allowed)}")
    return value


def check_physics(resolution: float | None, solver: str | None, arch: str, stability: bool) -> None:
    """Refuse options of the solver that cannot be right."""
    if resolution is not None and not 0 < resolution < LARGEST_RESOLUTION_M:
        raise InputError(f"--resolution {resolution} is not a cell size between 0 and {LARGEST_RESOLUTION_M} m")
    if solver is not None:
        choice("--solver", solver, SOLVERS)
    choice("--arch", arch, ARCHS)
    if stability and solver == "mls":
        raise InputError("--stability needs --solver tl; mls verifies no rest state that could be pushed")


def check_out(folder: Path) -> None:
    """Refuse a result folder that cannot be one before anything is computed."""
    nearest = next(one for one in (folder, *folder.absolute().parents) if os.path.exists(one))  # False if unreadable
    if not nearest.is_dir():
        raise InputError(f"--out {folder}: {nearest} is a file; give a folder")
    if not os.access(nearest, os.W_OK | os.X_OK):
        raise InputError(f"--out {folder}: {nearest} is not writable")
