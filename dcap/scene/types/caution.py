"""Messages of the stages: a plain text only explains how a result was made; a `Caution` asks a person for action.

Both travel in the same lists, in the order in which they came up. `placement.json` has the cautions as `warnings` and
the others as `notes`.
"""

from collections.abc import Iterable
from enum import StrEnum


class Cause(StrEnum):
    """Why a person should look at a result, the most important first."""

    NOT_MET = "not_met"
    """It was asked, and the result does not have it."""
    NOT_UNDERSTOOD = "not_understood"
    """Words of the sentence, or lines of a file of labels, that had no effect."""
    ASSUMED = "assumed"
    """A unit, an axis, a size or a shape was guessed, and the result depends on it."""
    WHICH = "which"
    """Another thing, or another side of it, may be meant."""


class Caution(str):
    """A message that asks for action."""

    __slots__ = ("cause",)
    cause: Cause

    def __new__(cls, cause: Cause, text: str) -> "Caution":
        """The message with its cause."""
        made = super().__new__(cls, text)
        made.cause = cause
        return made

    def __getnewargs__(self) -> tuple[Cause, str]:  # type: ignore[override]
        return self.cause, str(self)


def about(subject: str, message: str) -> str:
    """A message with the thing that it is about in front; a caution stays one."""
    text = f"{subject}: {message}"
    return Caution(message.cause, text) if isinstance(message, Caution) else text


def cautions(messages: Iterable[str]) -> list[Caution]:
    """Those that ask for action, the most important cause first, each once."""
    order = list(Cause)
    found = dict.fromkeys(one for one in messages if isinstance(one, Caution))
    return sorted(found, key=lambda one: order.index(one.cause))


def explanations(messages: Iterable[str]) -> list[str]:
    """The others, each once."""
    return list(dict.fromkeys(one for one in messages if not isinstance(one, Caution)))
