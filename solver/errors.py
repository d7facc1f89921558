"""Errors of the solver: broken promises, never expected outcomes."""


class SolverError(Exception):
    """Root of the solver's errors."""


class ModelError(SolverError):
    """The input cannot be simulated; names the body, the value and the bound."""


class UnstableStep(SolverError):  # noqa: N818  the name is part of the contract
    """A step broke (inverted map, non-finite state, no descent); names time, body, value and bound."""


class ArchError(SolverError):
    """The kernels cannot run on the requested processor; names it and the alternative."""
