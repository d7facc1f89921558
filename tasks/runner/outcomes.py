"""How a stage or a sample ended, in a line."""

from dcap.scene.errors import DcapError
from dcap.scene.machine_errors import machine_error
from dcap.scene.secrets import redacted
from dcap.scene.types.outcome import Infeasible


def known_error(error: BaseException) -> DcapError | None:
    """The error as one that a person can mend; None for a mistake of ours."""
    return error if isinstance(error, DcapError) else machine_error(error)


def error_line(error: BaseException) -> str:
    """What went wrong, without secrets; the kind of an error that is a mistake of ours is told with it."""
    known = known_error(error)
    words = str(known) if known else f"{type(error).__name__}: {ends(str(error))}"
    return redacted(" ".join(words.split()))


def ends(text: str) -> str:
    """Of a text that ends in a traceback, the last words of a process, the first line and the one that names the error:
    the last that is not indented."""
    lines = [line for line in text.splitlines() if line.strip() and not line[0].isspace()]
    return " … ".join([lines[0], lines[-1]]) if any(line.startswith("Traceback") for line in lines[:-1]) else text


def reason_line(found: Infeasible) -> str:
    """Why there is no value."""
    return " ".join(f"{found.reason}: {found.message}".split()).rstrip(": ")
