"""Messages of the stages: plain text explains how a result was made; a `Caution` asks a person for action.

Both travel in the same lists, in their order of occurrence. `placement.json` has the cautions as `warnings` and
the others as `notes`.
"""

from collections.abc import Iterable
from enum import StrEnum


class Cause(StrEnum):
    """Reasons for a person to check a result, the most important first."""

    NOT_MET = "not_met"
    """A request that the result does not meet."""
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
    """A message prefixed with its subject; a caution stays one."""
    text = f"{subject}: {message}"
    return Caution(message.cause, text) if isinstance(message, Caution) else text


def cautions(messages: Iterable[str]) -> list[Caution]:
    """Messages that ask for action, the most important cause first, each once."""
    order = list(Cause)
    found = dict.fromkeys(one for one in messages if isinstance(one, Caution))
    return sorted(found, key=lambda one: order.index(one.cause))


def explanations(messages: Iterable[str]) -> list[str]:
    """The other messages, each once."""
    return list(dict.fromkeys(one for one in messages if not isinstance(one, Caution)))
