"""What `--arch` stands for on this machine, settled before anything is computed or looked up in the cache."""

from dcap.scene.errors import InputError
from solver.errors import ArchError
from solver.runtime import available_arch


def chosen_arch(wanted: str) -> str:
    """`cpu` or `cuda` for `auto`, `cpu` or `cuda`; raises InputError for a graphics card that is not there."""
    try:
        return available_arch(wanted)
    except ArchError as error:
        raise InputError(f"--arch {error}") from error
