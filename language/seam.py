"""The seam between stages and language: six questions, and who answers them.

Stages call `client(name, model)` and never learn which client they got. `offline` needs nothing, `anthropic` asks a
model.
"""

from enum import StrEnum
from typing import Protocol

from language.replies import AnchorReply, IntentReply, LabelReply, MaterialsReply, PartsReply, RotationReply
from language.requests import (
    AnchorRequest,
    IntentRequest,
    LabelRequest,
    MaterialsRequest,
    PartsRequest,
    RotationRequest,
)


class ClientName(StrEnum):
    """Who answers."""

    OFFLINE = "offline"
    ANTHROPIC = "anthropic"


DEFAULT_MODEL = "claude-sonnet-5-5"
"""Model that `anthropic` asks unless told otherwise."""


class Client(Protocol):
    """Answers each question with a reply that passed its own `check`."""

    def intent(self, request: IntentRequest) -> IntentReply:
        """Which base, how big, how heavy, which orientation and region."""

    def rotation(self, request: RotationRequest) -> RotationReply:
        """Which rotation."""

    def anchor(self, request: AnchorRequest) -> AnchorReply:
        """Which part and region."""

    def materials(self, request: MaterialsRequest) -> MaterialsReply:
        """Which material for each part."""

    def label(self, request: LabelRequest) -> LabelReply:
        """What a thing is."""

    def parts(self, request: PartsRequest) -> PartsReply:
        """What the parts of a thing are called."""


def client(name: ClientName, model: str = DEFAULT_MODEL) -> Client:
    """The client of that name."""
    if name is ClientName.ANTHROPIC:
        from language.anthropic_client import AnthropicClient

        return AnthropicClient(model)
    from language.offline import OfflineClient

    return OfflineClient()
