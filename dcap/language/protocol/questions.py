"""The questions that stages ask, six of our own method and those of the baselines.

Each says which request and which reply it takes, and how one is checked against the other. A stage says
`client.ask(INTENT, request)` and gets an `IntentReply`; it never learns who answered.
"""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Generic, TypeVar

from pydantic import BaseModel

from dcap.language.protocol.baseline_questions import LayoutReply, LayoutRequest, RelationsReply, RelationsRequest
from dcap.language.protocol.replies import (
    AnchorReply,
    IntentReply,
    LabelReply,
    MaterialsReply,
    PartsReply,
    RotationReply,
)
from dcap.language.protocol.requests import (
    AnchorRequest,
    IntentRequest,
    LabelRequest,
    MaterialsRequest,
    PartsRequest,
    RotationRequest,
)

RequestT = TypeVar("RequestT")
ReplyT = TypeVar("ReplyT", bound=BaseModel)


@dataclass(frozen=True, slots=True)
class Question(Generic[RequestT, ReplyT]):
    """A kind of question."""

    name: str
    """Also the name of its template: `prompts/NAME.system.j2`."""
    request: type[RequestT]
    reply: type[ReplyT]
    check: Callable[[ReplyT, RequestT], None]
    """Raises ValueError, with a sentence that a model can be shown, if the reply chooses what is not listed."""
    shared: tuple[str, ...] = ()
    """Fields of the request that many questions of a run have in common: sent first, so that they can be cached."""
    unseen: tuple[str, ...] = ()
    """Fields of the request that no model is shown: what only the stand-in answers from."""
    stand_in: Callable[[RequestT], ReplyT] | None = None
    """The function that answers offline, where that is not the reader of sentences."""

    def parsed(self, answer: object, request: RequestT) -> ReplyT:
        """An answer as a reply that fits the request; ValueError otherwise."""
        reply = self.reply.model_validate(answer)
        self.check(reply, request)
        return reply


INTENT = Question("intent", IntentRequest, IntentReply, IntentReply.check, ("instances", "room_center"))
ROTATION = Question("rotation", RotationRequest, RotationReply, RotationReply.check)
ANCHOR = Question("anchor", AnchorRequest, AnchorReply, AnchorReply.check)
MATERIALS = Question("materials", MaterialsRequest, MaterialsReply, MaterialsReply.check)
LABEL = Question("label", LabelRequest, LabelReply, LabelReply.check, ("labels",))
PARTS = Question("parts", PartsRequest, PartsReply, PartsReply.check, ("names",))
LAYOUTGPT = Question("layoutgpt", LayoutRequest, LayoutReply, LayoutReply.check, ("instances", "room_center"))
HOLODECK = Question("holodeck", RelationsRequest, RelationsReply, RelationsReply.check, ("instances", "room_center"))
