"""The interface between stages and language: one protocol, and the choice of the client behind it.

A stage gets a `Client` and never learns which one. The protocol is defined here, above all clients, because the digest
of a stage follows imports: a module that declares a parameter `client` thus depends on everything that may answer,
including the lexicon.
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
    """Answers questions with replies that passed their own check; raises LanguageError if it cannot."""

    def ask(self, question: Question[RequestT, ReplyT], request: RequestT) -> ReplyT:
        """The answer to one question."""

    def ask_all(self, question: Question[RequestT, ReplyT], requests: Sequence[RequestT]) -> list[ReplyT]:
        """Answers to independent questions, in their order."""


def connect(config: LanguageConfig, session: Session, idle: Idle = nullcontext) -> Client:
    """The client selected by a configuration, asking as `session` says; nothing is asked yet."""
    return OfflineClient() if config.client is ClientName.OFFLINE else model_client(config, session, idle)
