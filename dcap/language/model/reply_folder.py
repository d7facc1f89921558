"""A folder of raw replies, each under the digest of what was asked: what a run keeps, records or replays.

Layout: `MODEL/aa/DIGEST.json` with the question, what was sent (pictures by digest) and the reply as it came; what
was invalid to the end lies under `rejected/`. Files appear whole or not at all, and processes may share a folder.
Because the raw reply is kept, its parsing can change without asking again.
"""

import hashlib
import json
import os
import uuid
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dcap.language.model.payload import Payload
from dcap.scene.errors import LanguageError

REJECTED = "rejected"
MARK = "recording.json"
"""Names a recording, so that two recordings into the same path are told apart."""

Message = dict[str, Any]
"""A reply as the Messages API gives it, as JSON."""


@dataclass(frozen=True, slots=True)
class ReplyFolder:
    """Replies by model and digest."""

    root: Path

    def path(self, model: str, digest: str) -> Path:
        """Where the reply of a model to a payload lies."""
        return self.root / model / digest[:2] / f"{digest}.json"

    def read(self, model: str, digest: str) -> Message | None:
        """The reply, None if there is none."""
        path = self.path(model, digest)
        try:
            message = json.loads(path.read_bytes())["message"]
        except FileNotFoundError:
            return None
        except (ValueError, KeyError, TypeError) as error:
            raise LanguageError(f"{path}: not a recorded reply ({type(error).__name__}); remove the file") from None
        return dict(message)

    def write(self, model: str, digest: str, asked: Mapping[str, Any], message: Message) -> Path:
        """Keep a reply; `asked` is what was sent, for a person."""
        path = self.path(model, digest)
        write_whole(path, {"model": model, "asked": dict(asked), "message": message})
        return path

    def keep(self, model: str, payload: Payload, message: Message) -> Path:
        """Keep the reply to a payload."""
        return self.write(model, payload.digest, {"question": payload.question, **payload.readable()}, message)

    def reject(self, model: str, digests: Sequence[str]) -> Path | None:
        """Put replies aside, so that they are asked for again; where the last of them lies then."""
        last = None
        for digest in digests:
            path = self.path(model, digest)
            if path.is_file():
                last = self.root / REJECTED / model / f"{digest[:16]}-{uuid.uuid4().hex[:8]}.json"
                last.parent.mkdir(parents=True, exist_ok=True)
                path.replace(last)
        return last

    def models(self) -> list[str]:
        """Models whose replies are here."""
        return sorted({path.parent.parent.name for path in self._files()} - {REJECTED})

    def content(self) -> str:
        """Digest over all replies, 16 hex digits."""
        names = [
            f"{path.relative_to(self.root)} {hashlib.sha256(path.read_bytes()).hexdigest()}" for path in self._files()
        ]
        return hashlib.sha256("\n".join(names).encode()).hexdigest()[:16]

    def mark(self) -> str:
        """Name of the recording in this folder, given to it now if it has none."""
        path = self.root / MARK
        if not path.is_file():
            write_whole(path, {"recording": uuid.uuid4().hex[:16]})
        return str(json.loads(path.read_bytes())["recording"])

    def _files(self) -> list[Path]:
        return sorted(self.root.glob("*/[0-9a-f][0-9a-f]/*.json"))


def write_whole(path: Path, tree: Mapping[str, object]) -> None:
    """Write a JSON file next to its place, then rename it."""
    path.parent.mkdir(parents=True, exist_ok=True)
    draft = path.with_name(f".{path.name}.{uuid.uuid4().hex[:8]}")
    draft.write_text(json.dumps(tree, indent=1, ensure_ascii=False, sort_keys=True) + "\n", encoding="utf-8")
    os.replace(draft, path)
