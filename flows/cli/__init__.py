"""The command line of DCAP: `dcap ...`, or `python -m flows.cli ...`."""

import os
import sys

from flows.interrupts import INTERRUPTED, flush_output, interruptible, say_interrupted

__all__ = ["main"]


def main(arguments: list[str] | None = None) -> int:
    """Run a command line, default that of the process, and return the contract's exit code.

    A process whose own command was interrupted ends here, at once: it would wait for threads whose stages compute. So
    does one whose server is gone: it would go on asking it.
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
    if arguments is None and (code == INTERRUPTED or has_given_up_its_server()):
        flush_output()
        os._exit(code)
    return code


def has_given_up_its_server() -> bool:
    """Whether this program has waited in vain for its server."""
    waiting = sys.modules.get("flows.server_wait")
    return waiting is not None and bool(waiting.GIVEN_UP)
