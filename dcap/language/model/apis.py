"""The APIs through which a model can be asked, by the client's name."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path

from dcap.language.model import anthropic_api, openai_api
from dcap.language.model.anthropic_api import size_of
from dcap.language.model.ledger import Ledger
from dcap.language.model.payload import Payload
from dcap.language.model.reply_folder import Message
from dcap.language.protocol.client import ClientName, LanguageConfig
from dcap.language.protocol.session import Session
from dcap.scene.errors import RefusedError


@dataclass(frozen=True, slots=True)
class ModelApi:
    """Access to one API."""

    reply_of: Callable[[LanguageConfig, Payload, Session], Message]
    """The reply to one call."""
    endpoint: Callable[[], str]
    """Address of the API if it is not the default."""
    address_variable: str
    """Environment variable for another address."""
    check: Callable[[], None] = lambda: None
    """Raises InputError if a required package is not installed."""

    def ask_at_once(self, config: LanguageConfig, payload: Payload, session: Session) -> Message:
        """The reply to one call, recorded in the ledger; RefusedError: nothing was done, and nothing is charged."""
        ledger = Ledger(Path(session.ledger) if session.ledger else None, session.max_cost, session.sample)
        tokens = payload.tokens(session.max_tokens)
        booked = ledger.reserve(config.model, payload.question, size_of(payload), tokens)
        try:
            message = self.reply_of(config, payload, session)
        except RefusedError:
            ledger.release(booked)
            raise
        ledger.settle(booked, config.model, payload.question, message, how="asked", digest=payload.digest)
        return message


APIS: Mapping[ClientName, ModelApi] = {
    ClientName.ANTHROPIC: ModelApi(anthropic_api.reply_of, anthropic_api.endpoint, "ANTHROPIC_BASE_URL"),
    ClientName.OPENAI: ModelApi(
        openai_api.reply_of, openai_api.endpoint, "OPENAI_BASE_URL", openai_api.check_installed
    ),
}
