"""How questions are asked in this run: where replies are kept, what may be spent. Never decides what a reply says.

A flow opens a session (`with speaking(...)`), stages run inside it, and a stage that runs in a process of its own
gets it as JSON. Without one, replies are kept in the data folder, and nothing is counted.
"""

from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from contextvars import ContextVar
from dataclasses import asdict, dataclass
from pathlib import Path

from dcap.scene.settings import replies_root


@dataclass(frozen=True, slots=True)
class Session:
    """Everything about asking that is no part of a stage's configuration."""

    kept: str = ""
    """Folder of raw replies that outlives the run; empty: `replies` of the data folder."""
    record: str = ""
    """Folder that gets a copy of every reply that is used."""
    replay: str = ""
    """Folder that recorded replies are read from."""
    ledger: str = ""
    """File that gets a line per reply with its tokens and cost."""
    max_cost: float | None = None
    """What the run may spend at most [USD]."""
    fresh: bool = False
    """Ask although a reply is kept."""
    batch: str = ""
    """Folder of a batch desk; empty: ask at once."""
    sample: str = ""
    """Whom the questions are about, for the ledger."""

    @property
    def kept_folder(self) -> Path:
        """Folder of raw replies that outlives the run."""
        return Path(self.kept) if self.kept else replies_root()

    def to_json(self) -> dict[str, object]:
        """Plain form for a process of its own."""
        return asdict(self)


_session: ContextVar[Session | None] = ContextVar("session", default=None)
_idle: ContextVar[Callable[[], AbstractContextManager[object]]] = ContextVar("idle", default=nullcontext)


def current_session() -> Session:
    """The session of this thread."""
    return _session.get() or Session()


@contextmanager
def speaking(session: Session, idle: Callable[[], AbstractContextManager[object]] | None = None) -> Iterator[Session]:
    """Ask as `session` says in this block and thread; `idle()` is entered while a question waits for long."""
    token, idle_token = _session.set(session), _idle.set(idle or nullcontext)
    try:
        yield session
    finally:
        _session.reset(token)
        _idle.reset(idle_token)


def idling() -> AbstractContextManager[object]:
    """Around a long wait: lets others work."""
    return _idle.get()()
