"""How a stage or a sample ended, in a line."""

from dcap.scene.errors import DcapError
from dcap.scene.types.outcome import Infeasible


def error_line(error: BaseException) -> str:
    """What went wrong; the kind of an error that is a mistake of ours is told with it."""
    kind = "" if isinstance(error, DcapError) else f"{type(error).__name__}: "
    return " ".join(f"{kind}{error}".split())


def reason_line(found: Infeasible) -> str:
    """Why there is no value."""
    return " ".join(f"{found.reason}: {found.message}".split()).rstrip(": ")
