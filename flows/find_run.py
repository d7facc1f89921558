"""Which folder a run has: what a command can tell at once, before anything is imported that computes."""

from pathlib import Path

from dcap.scene.errors import InputError
from dcap.scene.settings import runs_root

RUN = "run.json"
"""What was asked of a run."""


def find_run(run: str) -> Path:
    """Folder of a run by name, path or `last`."""
    for folder in (runs_root() / run, Path(run)):
        if (folder / RUN).is_file():
            return folder.resolve()
    known = sorted(path.parent.name for path in runs_root().glob(f"*/{RUN}"))
    raise InputError(f"{run!r} is not a run; there are {', '.join(known) or 'none'} in {runs_root()}")
