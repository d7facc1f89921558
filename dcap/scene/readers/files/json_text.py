"""JSON of foreign files: parsed, or refused with one line that names the file and the place."""

import json
from pathlib import Path

from dcap.scene.errors import FormatError
from dcap.scene.readers.files.content import read_bytes


def read_json(path: Path) -> object:
    """The tree of a JSON file in UTF-8, with or without a byte order mark."""
    return parse_json(path, read_bytes(path), "JSON")


def parse_json(path: Path, text: bytes, what: str) -> object:
    """The tree of a JSON text; `what` names it in messages."""
    try:
        tree: object = json.loads(text.decode("utf-8-sig"))
        if b"\\ud" in text or b"\\uD" in text:  # halves of surrogate pairs parse, but cannot be written again
            json.dumps(tree, ensure_ascii=False).encode()
    except UnicodeEncodeError:
        raise FormatError(f"{path}: broken {what}: a string contains an unpaired surrogate") from None
    except (ValueError, RecursionError) as error:
        raise FormatError(f"{path}: broken {what}: {error}") from None
    return tree
