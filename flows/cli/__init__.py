"""The command line of DCAP: `dcap ...`, or `python -m flows.cli ...`."""

import os

from flows.interrupts import INTERRUPTED, flush_output, interruptible, say_interrupted

__all__ = ["main"]


def main(arguments: list[str] | None = None) -> int:
    """Run a command line, default that of the process, and return the contract's exit code.

    A process whose own command was interrupted ends here, at once: it would wait for threads whose stages compute.
    """
    with interruptible(own=arguments is None):
        try:
            from flows.cli import app  # a second on a slow machine, in which a person may think better of it

            code = app.main(arguments)
        except KeyboardInterrupt:  # before the command itself began
            say_interrupted()
            code = INTERRUPTED
        except SystemExit as ended:
            if ended.code != INTERRUPTED or arguments is not None:
                raise
            say_interrupted()
            code = INTERRUPTED
    if code == INTERRUPTED and arguments is None:
        flush_output()
        os._exit(code)
    return code
