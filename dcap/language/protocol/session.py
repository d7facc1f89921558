"""How questions are asked in this run: where replies are kept, what may be spent. Never decides what a reply says.

A flow makes a session, the runner hands it to the client of each stage, and a stage that runs in a process of its own
gets it as JSON. A plain session keeps replies in the data folder and counts nothing.
"""

from dataclasses import asdict, dataclass
from pathlib import Path

from dcap.scene.settings import replies_root

MAX_TOKENS = 16_000
"""Longest answer unless told otherwise [tokens], thoughts included; without them the largest reply takes about 1500."""
MOST_TOKENS = 64_000
"""Longest answer that all models in prices.csv can give [tokens]."""
TIMEOUT = 600.0
"""Longest wait for one answer unless told otherwise [s]; a model may think before it answers."""


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
    """Most that the run may spend [USD]."""
    fresh: bool = False
    """Ask although a reply is kept."""
    batch: str = ""
    """Folder of a batch queue; empty: ask at once."""
    sample: str = ""
    """Whom the questions are about, for the ledger."""
    max_tokens: int = MAX_TOKENS
    """Longest answer, thoughts included; one that is cut off there is asked for again with more room."""
    timeout: float = TIMEOUT
    """Longest wait for one answer [s]."""

    @property
    def kept_folder(self) -> Path:
        """Folder of raw replies that outlives the run."""
        return Path(self.kept) if self.kept else replies_root()

    def to_json(self) -> dict[str, object]:
        """Plain form for a process of its own."""
        return asdict(self)
