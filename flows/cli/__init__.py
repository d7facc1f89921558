"""The command line of DCAP: `dcap ...`, or `python -m flows.cli ...`."""

import os
import sys

from flows.cli import app
from flows.cli.border import INTERRUPTED

__all__ = ["main"]


def main(arguments: list[str] | None = None) -> int:
    """Run a command line, default that of the process, and return the contract's exit code.

    A process whose own command was interrupted ends here, at once: it would wait for threads whose stages compute.
    """
    if arguments is not None:
        return app.main(arguments)
    try:
        code = app.main()
    except SystemExit as ended:
        if ended.code != INTERRUPTED:
            raise
        code = INTERRUPTED
    if code == INTERRUPTED:
        sys.stdout.flush()
        sys.stderr.flush()
        os._exit(code)
    return code
