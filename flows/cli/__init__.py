"""The command line of DCAP: `dcap ...`, or `python -m flows.cli ...`."""

from flows.cli.app import main

__all__ = ["main"]
