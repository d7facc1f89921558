"""The border of the command line: words that come in, and errors that go out as one line and an exit code.

What a person can mend is one line on standard error; a mistake of ours keeps its traceback. Who reads our output may
stop reading: the program ends then without a word, as others do.
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
from dcap.scene.given_text import LONGEST_WORDS, shortened, visible
from dcap.scene.machine_errors import machine_error
from dcap.scene.secrets import redacted

LACKING = {
    "int_parsing": "is not a whole number",
    "int_from_float": "is not a whole number",
    "float_parsing": "is not a number",
    "bool_parsing": "is neither true nor false",
    "greater_than_equal": "is less than {ge}",
    "less_than_equal": "is more than {le}",
}
"""What is wrong with a value, by the kind of a validation error."""
SHOWN = 100
"""Characters of a value that are shown."""
USAGE = 2
UNREAD = 141
"""As a shell shows a program that ended because nobody read its output: 128 and SIGPIPE."""


def check_words(words: list[str]) -> None:
    """Refuse words that no file can hold as they are: a shell hands over any bytes."""
    for number, word in enumerate(words, start=1):
        try:
            word.encode()
        except UnicodeEncodeError:
            shown = shortened(ascii(word), LONGEST_WORDS)
            raise InputError(
                f"argument {number}, {shown}, is not valid UTF-8; rename the file, or check the terminal's encoding"
            ) from None


def end_output() -> None:
    """Hand over what was printed: a full disk or a reader that left would else be told after the end."""
    if sys.stdout is not None:
        sys.stdout.flush()


def told(error: Exception) -> int:
    """Say what went wrong and return the exit code; an error that is a mistake of ours is raised again."""
    if isinstance(error, OSError) and not error.filename and (failed := output_failure()):
        drop_output()
        if not isinstance(failed, BrokenPipeError):
            complain(f"standard output: {failed.strerror}; send it elsewhere")
        let_go(error)
        return UNREAD if isinstance(failed, BrokenPipeError) else USAGE
    if isinstance(error, typer.TyperException):
        complain(value_refused(error) or error.format_message())
        return USAGE
    known = error if isinstance(error, DcapError) else machine_error(error)
    if known is None:
        raise error
    complain(str(known))
    drop_output()
    let_go(error)
    return known.exit_code


def value_refused(error: typer.TyperException) -> str:
    """Which value an option does not take, and what it lacks; empty where something else is wrong."""
    refused = error.__cause__
    if not isinstance(error, typer.BadParameter) or not isinstance(refused, ValidationError) or error.param is None:
        return ""
    first = refused.errors(include_url=False)[0]
    words = LACKING.get(first["type"])
    lacks = words.format(**first.get("ctx", {})) if words else f"is refused: {first['msg']}"
    return f"{max(error.param.opts, key=len)} {shortened(repr(first['input']), SHOWN)} {lacks}"


def complain(message: str) -> None:
    """One line on standard error, without secrets and nothing that steers a terminal; help stays as it is."""
    line = message if message.startswith("Usage:") else f"dcap: {visible(redacted(' '.join(message.split())))}"
    with suppress(OSError):  # standard error may be on a full disk too
        typer.echo(line, err=True)


def output_failure() -> OSError | None:
    """Why what was printed cannot be written; None where it can, or where that cannot be told any more.

    What failed is still waiting to be written, unless Python was told not to buffer; a pipe tells that nobody reads.
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


def drop_output() -> None:
    """Let nothing be left to be written at the end of the program, where a failure would be told once more."""
    try:
        end_output()
    except OSError:
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, sys.stdout.fileno())
        os.close(nowhere)


def let_go(error: BaseException) -> None:
    """Clear what the calls held through which an error came: Prefect keeps it, and Open3D ends a process in which one
    of its tensors is left with a status of its own."""
    waiting, seen = [error], set[int]()
    while waiting:
        one = waiting.pop()
        if id(one) not in seen:
            seen.add(id(one))
            traceback.clear_frames(one.__traceback__)
            waiting += [other for other in (one.__cause__, one.__context__) if other is not None]
