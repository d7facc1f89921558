"""The servers that a model can be asked through, by the client's name."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from dcap.language.model import anthropic_api, openai_api
from dcap.language.model.payload import Payload
from dcap.language.model.reply_folder import Message
from dcap.language.protocol.client import ClientName
from dcap.language.protocol.session import Session


@dataclass(frozen=True, slots=True)
class ModelApi:
    """How one is asked."""

    ask_at_once: Callable[[str, Payload, Session], Message]
    endpoint: Callable[[], str]
    """Address that is asked where it is not the usual one."""
    address_variable: str
    """Environment variable that names another address."""
    check: Callable[[], None] = lambda: None
    """InputError if what it needs is not installed."""


APIS: Mapping[ClientName, ModelApi] = {
    ClientName.ANTHROPIC: ModelApi(anthropic_api.ask_at_once, anthropic_api.endpoint, "ANTHROPIC_BASE_URL"),
    ClientName.OPENAI: ModelApi(
        openai_api.ask_at_once, openai_api.endpoint, "OPENAI_BASE_URL", openai_api.check_installed
    ),
}
