"""The client that answers a stage's questions, selected by its configuration.

`offline` needs nothing, `anthropic` and `openai` ask a model, `replay` repeats recorded answers. Settings that do not
affect a result (the place of stored replies, the budget) are not part of a stage's configuration: see
dcap/language/protocol/session.py.
"""

from collections.abc import Callable
from contextlib import AbstractContextManager
from enum import StrEnum
from typing import Literal
from urllib.parse import quote

from pydantic import BaseModel

Idle = Callable[[], AbstractContextManager[object]]
"""Makes the context that is entered while a question waits for long, so that others can work meanwhile."""


class ClientName(StrEnum):
    """The clients."""

    OFFLINE = "offline"
    ANTHROPIC = "anthropic"
    OPENAI = "openai"
    REPLAY = "replay"


DEFAULT_MODEL = "claude-sonnet-5-5"
"""Default model; `openai` has no default."""
Effort = Literal["", "none", "minimal", "low", "medium", "high", "xhigh", "max"]
"""Amount of thinking before an answer; empty: the model's default. Each model knows some of the words."""


class LanguageConfig(BaseModel, frozen=True, extra="forbid"):
    """The client that answers a stage's questions: the same in all stages of a run."""

    client: ClientName = ClientName.OFFLINE
    model: str = DEFAULT_MODEL
    """Model that is asked, or was when the replies were recorded; offline asks none."""
    effort: str = ""
    """One of Effort."""
    endpoint: str = ""
    """Host that is asked where it is not the usual one: a stand-in answers differently."""
    recording: str = ""
    """Which recording is written or replayed, empty for none: a result that left nothing in it must not be taken."""

    @property
    def source(self) -> str:
        """Name under which replies are stored, usable in a file name: `MODEL[+EFFORT][@ENDPOINT]`."""
        name = quote(self.model, safe="")  # behind gateways models are called "maker/model"
        name = f"{name}+{self.effort}" if self.effort else name
        return f"{name}@{self.endpoint}" if self.endpoint else name
