"""The command line of DCAP: `dcap ...`, or `python -m flows.cli ...`."""

import sys

from flows.interrupts import INTERRUPTED, end_now, end_on_signals, leave, was_interrupted

__all__ = ["main"]


def main(arguments: list[str] | None = None) -> int:
    """Run a command line, default that of the process, and return the contract's exit code.

    A process whose own command was interrupted ends here, at once: it would wait for threads whose stages compute. So
    does one whose Prefect server is lost: Prefect would try for minutes to tell it the rest.
    """
    if arguments is not None:
        from flows.cli import app

        return app.main(arguments)
    end_on_signals()
    try:
        from flows.cli import app  # a second on a slow machine, in which a person may think better of it

        code = app.main()
    except BaseException:
        if not was_interrupted():
            raise
        end_now()
    server = sys.modules.get("flows.server")
    if was_interrupted():
        leave(INTERRUPTED)
    if server is not None and server.was_given_up():
        leave(code)
    return code
