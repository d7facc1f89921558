"""The command line of DCAP: `dcap ...`, or `python -m flows.cli ...`."""

import sys

from flows.interrupts import INTERRUPTED, end_now, end_on_signals, leave, was_interrupted

__all__ = ["main"]


def main(arguments: list[str] | None = None) -> int:
    """Run a command line, default that of the process, and return the contract's exit code.

    A process whose own command was interrupted ends here at once instead of waiting for threads that compute. So does
    a process that has lost its Prefect server: Prefect would try for minutes to send it the remaining updates.
    """
    if arguments is not None:
        from flows.cli import app

        return app.main(arguments)
    end_on_signals()
    try:
        from flows.cli import app  # takes a second on a slow machine, in which the user may interrupt again

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
