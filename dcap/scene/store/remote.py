"""A store that several machines share: artifacts and records under any URL that fsspec opens.

`$DCAP_STORE` names it: `s3://bucket/prefix`, `gs://bucket`, a folder. An artifact is one object, the uncompressed tar
`objects/KIND/aa/SHA256.tar`: object stores show an object whole or not at all, and what a folder shows half-written
has another digest. A record is the object `records/KEY.json`. Nothing that is read here is trusted: an object larger
than ours are is not fetched, of an archive only plain files with plain names are unpacked, and they count only if their
digest is the wanted one. Foreign scenes and meshes (`Source`) stay on the machine that was given them.
"""

import errno
import re
import tarfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, BinaryIO

from dcap.scene.errors import StoreError
from dcap.scene.redaction import redacted_url, without_secrets
from dcap.scene.store.building import remove
from dcap.scene.store.digest import digest_of_folder, walk
from dcap.scene.store.ref import Ref

VARIABLE = "DCAP_STORE"
MOST_RECORD_BYTES = 16 << 20
"""Largest record that is read; ours have some tens of kilobytes."""
MOST_ARCHIVE_BYTES = 8**11
"""Largest artifact that is written or fetched: 8 GiB, what the header of a tar can say of a file in eleven digits.
Stages hold all of one in memory, so ours are far smaller."""
PIECE = 1 << 20
"""Bytes that are copied at once."""
PLAIN_NAME = re.compile(r"\w[\w.-]*")
"""Of a file in an artifact, as the codec names them."""
LONG_NAME = re.compile(rb"\d+ path=([^\n]{1,255})\n\0*")
"""Entry of an archive for a name of more than 100 bytes, or not in ASCII, that a file system takes."""
NOT_AN_ARCHIVE = (tarfile.TarError, ValueError, FileExistsError)
"""What a damaged archive is met with while it is read."""
LOCAL_DISK = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EROFS})
"""Errors that cannot come from the other side."""


class RemoteStore:
    """Artifacts and records of a team; safe for many threads, processes and machines at once."""

    def __init__(self, url: str) -> None:
        self.url = url
        self._filesystem: Any
        with self._telling("cannot be opened"):
            self._filesystem, self._root = opened_url(url)

    def fetch(self, ref: Ref[object], draft: Path) -> bool:
        """Unpack an artifact into an empty folder; false if there is none, or not a sound one."""
        archive = draft.with_name(f"{draft.name}.tar")
        try:
            with self._telling(f"{ref.kind} {ref.sha256[:12]} cannot be read"):
                path = self._object(ref)
                try:
                    if not self._is_fit(path, MOST_ARCHIVE_BYTES):
                        return False
                    self._filesystem.get_file(path, str(archive))
                except (FileNotFoundError, IsADirectoryError):
                    return False
            return unpack(archive, draft) and digest_of_folder(draft) == ref.sha256
        finally:
            remove(archive)

    def push(self, ref: Ref[object], folder: Path, archive: Path) -> None:
        """Write the artifact in a folder, over what is there; `archive` is a free name for the time being."""
        try:
            pack(folder, archive)
            if (size := archive.stat().st_size) > MOST_ARCHIVE_BYTES:
                limit = MOST_ARCHIVE_BYTES / 2**30
                raise StoreError(
                    f"{ref.kind} {ref.sha256[:12]} takes {size / 2**30:.1f} GiB > {limit:.0f} GiB, "
                    f"more than is fetched from a shared store; compute without {VARIABLE}"
                )
            with self._telling(f"{ref.kind} {ref.sha256[:12]} cannot be written"):
                self._filesystem.put_file(str(archive), self._object(ref))
        finally:
            remove(archive)

    def record(self, key: str) -> bytes | None:
        """The record of a key as it was pushed; None if there is none, or it has an absurd size."""
        path = self._record(key)
        with self._telling(f"record {key} cannot be read"):
            try:
                return bytes(self._filesystem.cat_file(path)) if self._is_fit(path, MOST_RECORD_BYTES) else None
            except (FileNotFoundError, IsADirectoryError):
                return None

    def push_record(self, key: str, data: bytes) -> None:
        """Write the record of a key, over what is there: its artifact may have been damaged."""
        with self._telling(f"record {key} cannot be written"):
            self._filesystem.pipe_file(self._record(key), data)

    def _is_fit(self, path: str, most: int) -> bool:
        """Whether an object has at most so many bytes; a pipe or a device in a shared folder has no end."""
        about = self._filesystem.info(path)
        return bool(about["type"] == "file" and about["size"] <= most)

    def _object(self, ref: Ref[object]) -> str:
        return f"{self._root}/objects/{ref.kind}/{ref.sha256[:2]}/{ref.sha256}.tar"

    def _record(self, key: str) -> str:
        return f"{self._root}/records/{key}.json"

    @contextmanager
    def _telling(self, what: str) -> Iterator[None]:
        """Turn what libraries of storages raise, each kinds of its own, into one line."""
        try:
            yield
        except StoreError:
            raise
        except Exception as error:
            if isinstance(error, OSError) and error.errno in LOCAL_DISK:
                raise StoreError(f"{what}: {error}") from None
            why = without_secrets(" ".join(str(error).split()) or type(error).__name__, self.url)
            raise StoreError(f"{VARIABLE}={redacted_url(self.url)}: {what}: {why}") from None


def opened_url(url: str) -> tuple[Any, str]:
    """The file system that a URL names and the path in it; fails where a bucket cannot be reached."""
    import fsspec  # with its protocols, which nobody waits for who shares nothing

    given = url if "://" in url else Path(url).resolve().as_uri()
    options: dict[str, object] = {"use_listings_cache": False}  # what others write must be seen
    if given.startswith(("file:", "local:")):
        options["auto_mkdir"] = True
    filesystem, root = fsspec.url_to_fs(given, **options)
    if not root.strip("/"):
        raise StoreError(f"{VARIABLE}={redacted_url(url)} names no bucket or folder")
    if hasattr(filesystem, "call_s3"):
        bucket = root.split("/")[0]
        try:
            filesystem.call_s3("head_bucket", Bucket=bucket)
        except FileNotFoundError:
            raise StoreError(f"{VARIABLE}={redacted_url(url)}: there is no bucket {bucket}; create it first") from None
    return filesystem, root.rstrip("/")


def pack(folder: Path, archive: Path) -> None:
    """Write the files of an artifact into a tar that depends on nothing but their names and bytes."""
    with tarfile.open(archive, "w:") as tar:
        for path in walk(folder):
            with path.open("rb") as file:
                about = tarfile.TarInfo(path.relative_to(folder).as_posix())
                about.size = path.stat().st_size
                tar.addfile(about, file)


def unpack(archive: Path, folder: Path) -> bool:
    """Whether an archive held plain files with plain names and nothing else; they lie in the folder then.

    `pack` writes few of the forms of a tar; Python's reader knows all, and holds in memory what their headers promise.
    """
    try:
        with archive.open("rb") as file:
            while (member := next_member(file)) is not None:
                if member.type != tarfile.REGTYPE or not PLAIN_NAME.fullmatch(member.name):
                    return False  # a link, a device, a hole, or a name that leads elsewhere
                with (folder / member.name).open("xb") as target:
                    if not copy_bytes(file, target, member.size):
                        return False
                padding = -member.size % tarfile.BLOCKSIZE
                if len(file.read(padding)) < padding:
                    return False
        return True
    except NOT_AN_ARCHIVE:
        return False


def next_member(file: BinaryIO) -> tarfile.TarInfo | None:
    """The header at the place where a file is, with its long name if one goes before; None at the archive's end."""
    block = file.read(tarfile.BLOCKSIZE)
    if block == bytes(tarfile.BLOCKSIZE):
        return None
    member = tarfile.TarInfo.frombuf(block, "utf-8", "surrogateescape")
    if member.type != tarfile.XHDTYPE:
        return member
    entry = LONG_NAME.fullmatch(file.read(tarfile.BLOCKSIZE))
    if entry is None or member.size > tarfile.BLOCKSIZE:
        raise tarfile.ReadError("more than a long name")
    member = tarfile.TarInfo.frombuf(file.read(tarfile.BLOCKSIZE), "utf-8", "surrogateescape")
    member.name = entry[1].decode()
    return member


def copy_bytes(source: BinaryIO, target: BinaryIO, count: int) -> bool:
    """Copy so many bytes; false if there are not so many."""
    while count > 0 and (piece := source.read(min(count, PIECE))):
        target.write(piece)
        count -= len(piece)
    return count == 0
