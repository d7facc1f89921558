"""Settings for asking questions in a run: storage of replies, budget. They never affect the content of a reply.

A flow makes a session, the runner passes it to the client of each stage, and a stage in its own process gets it as
JSON. A default session stores replies in the data folder and counts nothing.
"""

from dataclasses import asdict, dataclass
from pathlib import Path

from dcap.scene.settings import replies_root

MAX_TOKENS = 16_000
"""Default maximum length of an answer [tokens], including thoughts; without them the largest reply takes about 1500."""
MOST_TOKENS = 64_000
"""Maximum length of an answer that all models in prices.csv support [tokens]."""
TIMEOUT = 600.0
"""Default timeout of one answer [s]; a model may think before it answers."""


@dataclass(frozen=True, slots=True)
class Session:
    """All settings for asking that are not part of a stage's configuration."""

    kept: str = ""
    """Folder of raw replies that outlives the run; empty: `replies` in the data folder."""
    record: str = ""
    """Folder that gets a copy of every reply used."""
    replay: str = ""
    """Folder from which recorded replies are read."""
    ledger: str = ""
    """File that gets a line per reply with its tokens and cost."""
    max_cost: float | None = None
    """Maximum spending of the run [USD]."""
    fresh: bool = False
    """Whether to ask even if a reply is stored."""
    batch: str = ""
    """Folder of a batch queue; empty: ask immediately."""
    sample: str = ""
    """Id of the sample that the questions are about, for the ledger."""
    max_tokens: int = MAX_TOKENS
    """Maximum length of an answer, including thoughts; an answer cut off there is requested again with more room."""
    timeout: float = TIMEOUT
    """Timeout of one answer [s]."""

    @property
    def kept_folder(self) -> Path:
        """Folder of raw replies that outlives the run."""
        return Path(self.kept) if self.kept else replies_root()

    def to_json(self) -> dict[str, object]:
        """Plain form for a separate process."""
        return asdict(self)
