"""The tree of errors that a person can act on.

Every message says what went wrong, where, which value and which knob. `exit_code` is what the command line returns.
"""


class DcapError(Exception):
    """Root of all errors raised on purpose outside of `solver`."""

    exit_code = 2


class InputError(DcapError):
    """A path, option, key or value that the user gave cannot be used."""


class FormatError(InputError):
    """A file breaks the format it claims to have; names the file and the offset, element or key."""


class GeometryError(DcapError):
    """A mesh or point set cannot be used for what was asked."""


class NothingBeneathError(GeometryError):
    """A base has no surface where an object is to be dropped onto it."""


class LanguageError(DcapError):
    """A prompt was not understood, or a model's reply was invalid to the end."""


class RefusedError(LanguageError):
    """A model's API has told that it does not take a call: nothing was done, nothing is charged."""


class BudgetError(LanguageError):
    """What may be spent on a model is spent."""


class StoreError(DcapError):
    """An artifact is missing or does not match its digest."""


class MissingArtifactError(StoreError):
    """An artifact that a cache record names is gone or damaged: recompute it."""


class MachineError(DcapError):
    """What the program needs of its machine is not to be had: room on a disk, rights, memory, open files, a server."""
