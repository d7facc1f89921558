"""Resolves `--arch` on this machine, before anything is computed or looked up in the cache."""

from dcap.scene.errors import InputError
from solver.errors import ArchError


def chosen_arch(wanted: str) -> str:
    """`cpu` or `cuda` for `auto`, `cpu` or `cuda`; raises InputError for a missing graphics card."""
    if wanted == "cpu":
        return wanted  # every machine has one
    from solver.runtime import available_arch  # loads Taichi

    try:
        return available_arch(wanted)
    except ArchError as error:
        raise InputError(f"--arch {error}") from error
