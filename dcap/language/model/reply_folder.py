"""A folder of raw replies, each under the digest of its question: stored, recorded or replayed by a run.

Layout: `MODEL/aa/DIGEST.json` with the question, the payload sent (pictures by digest) and the reply as received;
replies that remained invalid are under `rejected/`. Files appear whole or not at all, and processes may share a folder.
Because the raw reply is stored, its parsing can change without asking again.
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
"""File with the id of a recording, which distinguishes two recordings into the same path."""

Message = dict[str, Any]
"""A reply in the form of the Messages API, as JSON."""


@dataclass(frozen=True, slots=True)
class ReplyFolder:
    """Replies by model and digest."""

    root: Path

    def path(self, model: str, digest: str) -> Path:
        """Path of the reply of a model to a payload."""
        return self.root / model / digest[:2] / f"{digest}.json"

    def read(self, model: str, digest: str) -> Message | None:
        """The reply; None if there is none."""
        path = self.path(model, digest)
        try:
            message = json.loads(path.read_bytes())["message"]
        except FileNotFoundError:
            return None
        except (ValueError, KeyError, TypeError) as error:
            raise LanguageError(f"{path}: not a recorded reply ({type(error).__name__}); remove the file") from None
        return dict(message)

    def write(self, model: str, digest: str, asked: Mapping[str, Any], message: Message) -> Path:
        """Store a reply; `asked` is the payload sent, for a person."""
        path = self.path(model, digest)
        write_whole(path, {"model": model, "asked": dict(asked), "message": message})
        return path

    def keep(self, model: str, payload: Payload, message: Message) -> Path:
        """Store the reply to a payload."""
        return self.write(model, payload.digest, {"question": payload.question, **payload.readable()}, message)

    def reject(self, model: str, digests: Sequence[str]) -> Path | None:
        """Set replies aside, so that they are asked for again; returns the new place of the last one."""
        last = None
        for digest in digests:
            path = self.path(model, digest)
            if path.is_file():
                last = self.root / REJECTED / model / f"{digest[:16]}-{uuid.uuid4().hex[:8]}.json"
                last.parent.mkdir(parents=True, exist_ok=True)
                path.replace(last)
        return last

    def models(self) -> list[str]:
        """Models with replies in this folder."""
        return sorted({path.parent.parent.name for path in self._files()} - {REJECTED})

    def content(self) -> str:
        """Digest over all replies, 16 hex digits."""
        names = [
            f"{path.relative_to(self.root)} {hashlib.sha256(path.read_bytes()).hexdigest()}" for path in self._files()
        ]
        return hashlib.sha256("\n".join(names).encode()).hexdigest()[:16]

    def mark(self) -> str:
        """Id of the recording in this folder, created if it has none."""
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
