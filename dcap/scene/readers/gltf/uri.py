"""Content that URIs of a glTF file stand for: data of their own, or a file next to the document."""

import base64
from pathlib import Path
from urllib.parse import unquote

from dcap.scene.errors import FormatError
from dcap.scene.readers.files.content import read_bytes
from dcap.scene.readers.files.references import absence, find_file


def uri_bytes(path: Path, uri: str) -> bytes:
    """Bytes of a data URI, or of a file next to the document at `path`."""
    if uri.startswith("data:"):
        try:
            return base64.b64decode(uri.partition(",")[2], validate=True)
        except ValueError as error:
            raise FormatError(f"{path}: a data URI is broken: {error}") from None
    found = find_file(path.parent, unquote(uri))
    if found is None:
        raise FormatError(f"{path}: the file {unquote(uri)!r} that it names {absence(unquote(uri))}")
    return read_bytes(path.parent / found)


def missing(path: Path, uri: str) -> str:
    """Why the file that a URI names is not there, to end a sentence with; empty if it is, or if the URI is data."""
    if uri.startswith("data:") or find_file(path.parent, unquote(uri)) is not None:
        return ""
    return absence(unquote(uri))
