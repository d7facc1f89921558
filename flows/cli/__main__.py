"""`python -m flows.cli`: the same as `dcap`."""

from flows.cli.app import main

main()
