"""The seam between stages and language: one protocol, and who stands behind it.

A stage is handed a `Client` and never learns which one it got. `offline` needs nothing, `anthropic` asks
a model, `replay` gives recorded answers again. What does not decide a result (where replies are kept, what may be
spent) is no part of a stage's configuration: see dcap/language/protocol/session.py.
"""

from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from enum import StrEnum
from typing import Protocol
from urllib.parse import quote

from pydantic import BaseModel

from dcap.language.protocol.questions import Question, ReplyT, RequestT
from dcap.language.protocol.session import Session

Idle = Callable[[], AbstractContextManager[object]]
"""What is entered while a question waits for long, so that others can work meanwhile."""


class ClientName(StrEnum):
    """Who answers."""

    OFFLINE = "offline"
    ANTHROPIC = "anthropic"
    REPLAY = "replay"


DEFAULT_MODEL = "claude-sonnet-5-5"
"""Model that is asked unless told otherwise."""


class LanguageConfig(BaseModel, frozen=True, extra="forbid"):
    """Who answers a stage's questions: the same in all stages of a run."""

    client: ClientName = ClientName.OFFLINE
    model: str = DEFAULT_MODEL
    """Model that is asked, or was when the replies were recorded; offline asks none."""
    endpoint: str = ""
    """Host that is asked where it is not the usual one: a stand-in answers differently."""
    recording: str = ""
    """Which recording is written or replayed, empty for none: a result that left nothing in it must not be taken."""

    @property
    def source(self) -> str:
        """Under which name replies are kept, fit for a file name."""
        name = quote(self.model, safe="")  # behind gateways models are called "maker/model"
        return f"{name}@{self.endpoint}" if self.endpoint else name


class Client(Protocol):
    """Answers questions with replies that passed their own check; LanguageError if it cannot."""

    def ask(self, question: Question[RequestT, ReplyT], request: RequestT) -> ReplyT:
        """The answer to one question."""

    def ask_all(self, question: Question[RequestT, ReplyT], requests: Sequence[RequestT]) -> list[ReplyT]:
        """Answers to questions that do not depend on each other, in their order."""


def connect(config: LanguageConfig, session: Session, idle: Idle = nullcontext) -> Client:
    """The client that a configuration names, asking as `session` says; nothing is asked yet."""
    if config.client is ClientName.OFFLINE:
        from dcap.language.offline.client import OfflineClient

        return OfflineClient()
    from dcap.language.model.client import model_client

    return model_client(config, session, idle)
