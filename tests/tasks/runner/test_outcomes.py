"""How a failure is told in a line."""

from dcap.scene.errors import FormatError
from tasks.runner.outcomes import error_line
from tasks.runner.process import StageProcessError

TAIL = """Traceback (most recent call last):
  File "coarse.py", line 219, in factorised
    factor = cho_factor(matrix)
             ^^^^^^^^^^^^^^^^^^
LinAlgError: 349-th leading minor of the array is not positive definite
"""


def test_the_last_words_of_a_process_are_told_by_their_error() -> None:
    """Not by a page of frames on one line, which the details keep."""
    said = error_line(StageProcessError(f"the stage's process ended with status 1\n{TAIL}"))
    assert said == ("StageProcessError: the stage's process ended with status 1 … "
                    "LinAlgError: 349-th leading minor of the array is not positive definite")  # fmt: skip


def test_a_known_error_is_told_whole() -> None:
    """Its lines are joined; a mistake of ours in one line has its kind before it."""
    assert error_line(FormatError("a.ply: broken\n  at byte 7")) == "a.ply: broken at byte 7"
    assert error_line(KeyError("x")) == "KeyError: 'x'"
    assert error_line(ValueError("")) == "ValueError:"
    assert error_line(ValueError("1 error for Config\n  size\n    too small\n")) == (
        "ValueError: 1 error for Config size too small"
    )
