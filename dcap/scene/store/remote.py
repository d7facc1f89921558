"""A store that several machines share: artifacts and records under any URL that fsspec opens.

`$DCAP_STORE` names it: `s3://bucket/prefix`, `gs://bucket`, a folder. An artifact is one object, the uncompressed tar
`objects/KIND/aa/SHA256.tar`: object stores show an object whole or not at all, and what a folder shows half-written
has another digest. A record is the object `records/KEY.json`. Nothing that is read here is trusted: of an archive only
plain files with plain names are unpacked, and they count only if their digest is the wanted one. Foreign scenes and
meshes (`Source`) stay on the machine that was given them.
"""

import errno
import re
import tarfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from shutil import copyfileobj
from typing import Any

from dcap.scene.errors import StoreError
from dcap.scene.redaction import redacted, without_secrets
from dcap.scene.store.building import remove
from dcap.scene.store.digest import digest_of_folder, walk
from dcap.scene.store.ref import Ref

VARIABLE = "DCAP_STORE"
MOST_RECORD_BYTES = 16 << 20
"""Largest record that is read; ours have some tens of kilobytes."""
PLAIN_NAME = re.compile(r"\w[\w.-]*")
"""Of a file in an artifact, as the codec names them."""
NOT_AN_ARCHIVE = (tarfile.TarError, EOFError, ValueError, OverflowError, RecursionError, FileExistsError)
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
                try:
                    self._filesystem.get_file(self._object(ref), str(archive))
                except (FileNotFoundError, IsADirectoryError):
                    return False
            return unpack(archive, draft) and digest_of_folder(draft) == ref.sha256
        finally:
            remove(archive)

    def push(self, ref: Ref[object], folder: Path, archive: Path) -> None:
        """Write the artifact in a folder, over what is there; `archive` is a free name for the time being."""
        try:
            pack(folder, archive)
            with self._telling(f"{ref.kind} {ref.sha256[:12]} cannot be written"):
                self._filesystem.put_file(str(archive), self._object(ref))
        finally:
            remove(archive)

    def record(self, key: str) -> bytes | None:
        """The record of a key as it was pushed; None if there is none, or it has an absurd size."""
        path = self._record(key)
        with self._telling(f"record {key} cannot be read"):
            try:
                size = self._filesystem.info(path)["size"]
                return bytes(self._filesystem.cat_file(path)) if size <= MOST_RECORD_BYTES else None
            except (FileNotFoundError, IsADirectoryError):
                return None

    def push_record(self, key: str, data: bytes) -> None:
        """Write the record of a key, over what is there: its artifact may have been damaged."""
        with self._telling(f"record {key} cannot be written"):
            self._filesystem.pipe_file(self._record(key), data)

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
            raise StoreError(f"{VARIABLE}={redacted(self.url)}: {what}: {why}") from None


def opened_url(url: str) -> tuple[Any, str]:
    """The file system that a URL names and the path in it; fails where a bucket cannot be reached."""
    import fsspec  # with its protocols, which nobody waits for who shares nothing

    given = url if "://" in url else Path(url).resolve().as_uri()
    options: dict[str, object] = {"use_listings_cache": False}  # what others write must be seen
    if given.startswith(("file:", "local:")):
        options["auto_mkdir"] = True
    filesystem, root = fsspec.url_to_fs(given, **options)
    if not root.strip("/"):
        raise StoreError(f"{VARIABLE}={redacted(url)} names no bucket or folder")
    if hasattr(filesystem, "call_s3"):
        bucket = root.split("/")[0]
        try:
            filesystem.call_s3("head_bucket", Bucket=bucket)
        except FileNotFoundError:
            raise StoreError(f"{VARIABLE}={redacted(url)}: there is no bucket {bucket}; create it first") from None
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
    """Whether an archive held plain files with plain names and nothing else; they lie in the folder then."""
    try:
        with tarfile.open(archive, "r:") as tar:
            return all(unpack_file(tar, member, folder) for member in tar)
    except NOT_AN_ARCHIVE:
        return False
    except IsADirectoryError:  # of a shared folder, where an object should be
        return False


def unpack_file(tar: tarfile.TarFile, member: tarfile.TarInfo, folder: Path) -> bool:
    """Unpack one file; false for a link, a device, a hole, or a name that leads elsewhere."""
    if member.type != tarfile.REGTYPE or member.issparse() or not PLAIN_NAME.fullmatch(member.name):
        return False
    data = tar.extractfile(member)
    if data is None:
        return False
    with (folder / member.name).open("xb") as file:
        copyfileobj(data, file)
    return True
