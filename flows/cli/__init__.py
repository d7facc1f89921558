"""The command line of DCAP: `dcap ...`, or `python -m flows.cli ...`."""

from flows.interrupts import end_on_signals, leave

__all__ = ["main"]


def main(arguments: list[str] | None = None) -> int:
    """Run a command line, default that of the process, and return the contract's exit code.

    A process whose own command was interrupted ends here, at once: it would wait for threads whose stages compute.
    """
    if arguments is None:
        end_on_signals()
    try:
        from flows.cli import app  # a second on a slow machine, in which a person may think better of it

        return app.main(arguments)
    except KeyboardInterrupt:
        if arguments is None:
            leave()
        return app.INTERRUPTED
