"""Boundary of the command line: checks its arguments, and turns errors into one line and an exit code.

An error that a user can fix is one line on standard error; a bug of ours keeps its traceback. If the reader of our
output stops reading, the program ends silently, as other programs do.
"""

import errno
import io
import os
import select
import sys
import traceback
from contextlib import suppress

import typer
from pydantic import ValidationError

from dcap.scene.errors import DcapError, InputError
from dcap.scene.secrets import redacted
from dcap.scene.text import LONGEST_WORDS, shortened, visible
from tasks.machine_errors import machine_error

LACKING = {
    "int_parsing": "is not a whole number",
    "int_from_float": "is not a whole number",
    "float_parsing": "is not a number",
    "bool_parsing": "is neither true nor false",
    "greater_than_equal": "is less than {ge}",
    "less_than_equal": "is more than {le}",
}
"""Descriptions of wrong values, by the kind of a validation error."""
SHOWN = 100
"""Characters of a value that are shown."""
USAGE = 2
UNREAD = 141
"""Exit code of a program whose output nobody reads: 128 and SIGPIPE, as a shell reports it."""


def check_words(words: list[str]) -> None:
    """Refuse arguments that are not valid UTF-8: a shell passes any bytes."""
    for number, word in enumerate(words, start=1):
        try:
            word.encode()
        except UnicodeEncodeError:
            shown = shortened(ascii(word), LONGEST_WORDS)
            raise InputError(
                f"argument {number}, {shown}, is not valid UTF-8; rename the file, or check the terminal's encoding"
            ) from None


def end_output() -> None:
    """Flush standard output, so that a full disk or a closed pipe is reported now rather than after the end."""
    if sys.stdout is not None:
        sys.stdout.flush()


def report_error(error: Exception) -> int:
    """Print an error as one line and return the exit code; an error that is a bug of ours is raised again."""
    if isinstance(error, OSError) and not error.filename and (failed := output_failure()):
        discard_output()
        if not isinstance(failed, BrokenPipeError):
            print_error(f"standard output: {failed.strerror}; redirect it elsewhere")
        clear_frames(error)
        return UNREAD if isinstance(failed, BrokenPipeError) else USAGE
    if isinstance(error, typer.TyperException):
        print_error(describe_refused_value(error) or error.format_message())
        return USAGE
    known = error if isinstance(error, DcapError) else machine_error(error)
    if known is None:
        raise error
    print_error(str(known))
    discard_output()
    clear_frames(error)
    return known.exit_code


def describe_refused_value(error: typer.TyperException) -> str:
    """Describe the value that an option refuses, and why; empty where something else is wrong."""
    refused = error.__cause__
    if not isinstance(error, typer.BadParameter) or not isinstance(refused, ValidationError) or error.param is None:
        return ""
    first = refused.errors(include_url=False)[0]
    words = LACKING.get(first["type"])
    lacks = words.format(**first.get("ctx", {})) if words else f"is refused: {first['msg']}"
    return f"{max(error.param.opts, key=len)} {shortened(repr(first['input']), SHOWN)} {lacks}"


def print_error(message: str) -> None:
    """Print one line on standard error without secrets and terminal control characters; help texts stay as they are."""
    line = message if message.startswith("Usage:") else f"dcap: {visible(redacted(' '.join(message.split())))}"
    with suppress(OSError):  # standard error may be on a full disk too
        typer.echo(line, err=True)


def output_failure() -> OSError | None:
    """Error that keeps printed text from being written; None if it can be written, or if that is no longer known.

    Text whose write failed is still in the buffer, unless Python runs unbuffered; a pipe reports that nobody reads.
    """
    try:
        end_output()
        waiting = select.poll()
        waiting.register(sys.stdout.fileno(), 0)
        gone = any(event & select.POLLERR for _, event in waiting.poll(0))
    except OSError as error:
        return None if isinstance(error, io.UnsupportedOperation) else error
    except AttributeError:
        return None  # no standard output, or a system that cannot ask
    return BrokenPipeError(errno.EPIPE, os.strerror(errno.EPIPE)) if gone else None


def discard_output() -> None:
    """Discard pending output, so that the failure is not reported once more when the program ends."""
    try:
        end_output()
    except OSError:
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, sys.stdout.fileno())
        os.close(nowhere)


def clear_frames(error: BaseException) -> None:
    """Clear the local variables of the frames in an error's traceback. Prefect keeps the error, and Open3D ends a
    process in which one of its tensors is still alive with an exit status of its own."""
    waiting, seen = [error], set[int]()
    while waiting:
        one = waiting.pop()
        if id(one) not in seen:
            seen.add(id(one))
            traceback.clear_frames(one.__traceback__)
            waiting += [other for other in (one.__cause__, one.__context__) if other is not None]
