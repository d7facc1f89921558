"""A store shared by several machines: files under any URL that fsspec opens (`$DCAP_STORE`: s3://..., a folder).

It holds the same files under the same names as the local cache: artifacts below `objects/`, records below `records/`.
Content read here only counts after its digest was checked, so a half-written artifact counts as missing.
"""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from dcap.scene.errors import StoreError
from dcap.scene.secrets import redacted_url, without_secrets

VARIABLE = "DCAP_STORE"
MOST_BYTES = 8 << 30
"""Largest artifact that is fetched [bytes]; stages hold whole artifacts in memory, so ours are far smaller."""


class SharedStore:
    """Files of a team; safe for many threads, processes and machines at once."""

    def __init__(self, url: str) -> None:
        self.url = url
        self._pushed: set[str] = set()
        self._names: dict[str, frozenset[str]] = {}
        with self._errors_as_one_line("cannot be opened"):
            import fsspec  # imported here, so that users without a shared store do not wait for it

            given = url if "://" in url else Path(url).resolve().as_uri()
            self._files: Any
            self._files, root = fsspec.url_to_fs(given, use_listings_cache=False)
            self._root = root.rstrip("/")
            if not self._root.strip("/"):
                raise StoreError(f"{VARIABLE}={redacted_url(url)} names no bucket or folder")
            bucket = self._root.split("/")[0]
            if hasattr(self._files, "call_s3"):
                try:
                    self._files.call_s3("head_bucket", Bucket=bucket)  # `exists` returns False if nobody answers
                except FileNotFoundError:
                    shown = f"{VARIABLE}={redacted_url(url)}"
                    raise StoreError(f"{shown}: there is no bucket {bucket}; create it first") from None

    def push(self, name: str, path: Path) -> None:
        """Write a file, or a folder of files, under a name, once per process."""
        if name in self._pushed:
            return
        with self._errors_as_one_line(f"{name} cannot be written"):
            for file in sorted(path.iterdir()) if path.is_dir() else (path,):
                target = f"{self._root}/{name}" + (f"/{file.name}" if path.is_dir() else "")
                self._files.makedirs(target.rpartition("/")[0], exist_ok=True)
                self._files.put_file(str(file), target)
        self._pushed.add(name)

    def fetch(self, name: str, folder: Path) -> None:
        """Copy the files of an artifact into a folder; copies nothing if there is no such artifact, or if it is too
        large."""
        with self._errors_as_one_line(f"{name} cannot be read"):
            found: dict[str, dict[str, Any]] = self._files.find(f"{self._root}/{name}", detail=True)
            if sum(about["size"] for about in found.values()) <= MOST_BYTES:
                for path in found:
                    self._files.get_file(path, str(folder / path.rpartition("/")[2]))

    def names(self, folder: str) -> frozenset[str]:
        """Return the names of the files in a folder, as they were when this process first asked."""
        if folder not in self._names:
            with self._errors_as_one_line(f"{folder} cannot be listed"):
                try:
                    found = self._files.ls(f"{self._root}/{folder}", detail=False)
                except FileNotFoundError:
                    found = []
            self._names[folder] = frozenset(str(one).rpartition("/")[2] for one in found)
        return self._names[folder]

    def read(self, name: str) -> bytes | None:
        """Return the content of a file; None if it does not exist."""
        with self._errors_as_one_line(f"{name} cannot be read"):
            try:
                return bytes(self._files.cat_file(f"{self._root}/{name}"))
            except FileNotFoundError:
                return None

    @contextmanager
    def _errors_as_one_line(self, what: str) -> Iterator[None]:
        """Turn the errors of storage libraries, which have classes of their own, into a one-line StoreError."""
        try:
            yield
        except StoreError:
            raise
        except Exception as error:
            why = without_secrets(" ".join(str(error).split()) or type(error).__name__, self.url)
            raise StoreError(f"{VARIABLE}={redacted_url(self.url)}: {what}: {why}") from None
