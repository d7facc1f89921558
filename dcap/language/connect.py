"""The seam between stages and language: one protocol, and who stands behind it.

A stage is handed a `Client` and never learns which one it got. The protocol stands here, above all clients, because a
stage's digest follows imports: whoever declares a parameter `client` reaches what may answer, the lexicon included.
"""

from collections.abc import Sequence
from contextlib import nullcontext
from typing import Protocol

from dcap.language.model.client import model_client
from dcap.language.offline.client import OfflineClient
from dcap.language.protocol.client import ClientName, Idle, LanguageConfig
from dcap.language.protocol.questions import Question, ReplyT, RequestT
from dcap.language.protocol.session import Session


class Client(Protocol):
    """Answers questions with replies that passed their own check; LanguageError if it cannot."""

    def ask(self, question: Question[RequestT, ReplyT], request: RequestT) -> ReplyT:
        """The answer to one question."""

    def ask_all(self, question: Question[RequestT, ReplyT], requests: Sequence[RequestT]) -> list[ReplyT]:
        """Answers to questions that do not depend on each other, in their order."""


def connect(config: LanguageConfig, session: Session, idle: Idle = nullcontext) -> Client:
    """The client that a configuration names, asking as `session` says; nothing is asked yet."""
    return OfflineClient() if config.client is ClientName.OFFLINE else model_client(config, session, idle)
