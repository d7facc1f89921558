"""Problems outside our code as one line: disks, permissions, open files, memory, the server of the runs.

In: an exception. Out: the line with the path and the remedy, or None for a mistake of ours, whose traceback must be
shown. Errors of Prefect's client are recognised by the modules of their classes, so nothing is imported for them.
The address of the server, ours or a team's, is in $PREFECT_API_URL during a run, for this process and all its children.
"""

import errno
import os
import shutil
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from subprocess import SubprocessError

from dcap.scene.errors import DcapError, InputError, MachineError
from dcap.scene.secrets import redacted, redacted_url
from dcap.scene.settings import data_root, server_folder
from dcap.scene.text import shortened
from dcap.scene.written_files import FULL

REFUSED = (errno.EACCES, errno.EPERM, errno.EROFS)
NO_FOLDER = (errno.ENOTDIR, errno.ENOENT)
EXHAUSTED = (errno.EMFILE, errno.ENFILE)
SERVER = ("httpx", "httpcore")
"""Packages whose errors mean that the server of the runs does not respond properly; Prefect's own errors are among
them."""
UNLOADED = ("failed to map segment", "annot allocate memory")
"""Messages of the loader for a library that does not fit into memory."""
NO_SERVER = "Failed to reach API"
"""Text of Prefect's plain RuntimeError if its server is gone."""
GIVEN_UP = "Retry handling ended"
"""Beginning of the RuntimeError of Prefect's client if the server is given up during a wait."""
ANSWERS = (*SERVER, "prefect")
"""Packages whose errors can be responses of a server."""
UNAUTHORIZED, REFUSALS = 401, range(400, 500)
LONGEST_PATH, LONGEST_WORDS = 200, 300
"""Maximum lengths of a path and of foreign text in a line [characters]."""
ROOMY = 64 << 20
"""Free space below which a disk is mentioned as a possible reason for a server problem [bytes]."""
API_URL = "PREFECT_API_URL"
"""Prefect's variable with the address of the server."""
LOGIN = "PREFECT_API_AUTH_STRING"
"""Prefect's variable with `NAME:PASSWORD` for clients."""
OWN_URL = "DCAP_OWN_SERVER"
"""Variable with the address of the server started by this project."""


def machine_error(error: BaseException) -> MachineError | None:
    """The MachineError for an exception with a cause outside our code; None for any other exception."""
    if isinstance(error, MachineError):
        return error
    if isinstance(error, OSError):
        return MachineError(redacted(_of_system(error)))
    if isinstance(error, MemoryError):
        words = f" ({error})" if str(error) else ""
        return MachineError(f"out of memory{words}; {_knob_of_memory()}")
    if isinstance(error, ImportError) and any(words in str(error) for words in UNLOADED):
        return MachineError(f"out of memory, or of a limit (ulimit -v): {_words(error)}; {_knob_of_memory()}")
    if isinstance(error, SubprocessError):
        return MachineError(redacted(_words(error)))
    if _status(error) == UNAUTHORIZED:
        wants = f"rejects the value of {LOGIN}" if os.environ.get(LOGIN) else "requires authentication"
        server = team_server() or "of this program"
        return MachineError(f"the Prefect server {server} {wants}; set {LOGIN}=NAME:PASSWORD")
    if _of_server(error):
        return MachineError(redacted(f"the Prefect server: {_words(error)}; {_of_the_server()}"))
    return None


def team_server() -> str:
    """Address of a team's server, without secrets; empty if the server is our own or there is none."""
    url = os.environ.get(API_URL, "")
    return "" if url == os.environ.get(OWN_URL) else redacted_url(url)


@contextmanager
def as_machine_errors() -> Iterator[None]:
    """Raise exceptions with a cause outside our code as MachineError."""
    try:
        yield
    except DcapError:
        raise
    except Exception as error:
        known = machine_error(error)
        if known is None:
            raise
        raise known from error


def _of_system(error: OSError) -> str:
    """The operation that the system refused, the place and the remedy."""
    why = error.strerror or _words(error) or type(error).__name__
    path = _path(error)
    where = f"{shortened(path, LONGEST_PATH)}: " if path else ""
    if error.errno in FULL:
        return f"{where}{why}; {_room(path)}"
    if error.errno in EXHAUSTED:
        return f"{where}{why}; raise the limit (ulimit -n), or give fewer --workers"
    if error.errno == errno.ENOMEM:
        return f"{where}{why}; {_knob_of_memory()}"
    if error.errno in REFUSED and path:
        return f"{where}{why}; change its permissions, or name another place with {_knob(Path(path))}"
    if error.errno == errno.ENAMETOOLONG:
        return f"{where}{why}; give a shorter name"
    knob = _knob(Path(path)) if path else ""
    if error.errno in NO_FOLDER and knob.startswith("DCAP_DATA"):
        return f"{where}{why}; {knob} must be a folder that can be written"
    return f"{where}{why}"


def _path(error: OSError) -> str:
    """The file that an error is about, the written one of two; empty if the error does not name it."""
    name = error.filename2 or error.filename
    return os.fsdecode(name) if isinstance(name, str | bytes | os.PathLike) else ""


def _data_root() -> Path | None:
    """$DCAP_DATA or its default; None if it is invalid."""
    try:
        return data_root()
    except InputError:
        return None


def _knob(path: Path) -> str:
    """The setting that determines the place of a file."""
    data = _data_root()
    if data is not None and path.absolute().is_relative_to(data):
        return f"DCAP_DATA (now {data})"
    return "TMPDIR" if path.absolute().is_relative_to(tempfile.gettempdir()) else "--out"


def _room(path: str) -> str:
    """Free space on the disk of a file to be written, and on other disks with our files."""
    data = _data_root()
    places = [("its folder", Path(path) if Path(path).is_dir() else Path(path).parent)] if path else []
    places += [("DCAP_DATA", data)] if data else []
    places += [("TMPDIR", Path(tempfile.gettempdir())), ("the working directory", Path(os.curdir))]
    free = [f"{_free_space(place) / 2**20:.0f} MiB in {name} ({place})" for name, place in places]
    return f"free space: {', '.join(free)}; make room, or set DCAP_DATA, TMPDIR or --out to another disk"


def _free_space(path: Path) -> int:
    """Free bytes on the disk of a folder, which need not exist yet; 0 if unknown."""
    nearest = next((one for one in (path, *path.absolute().parents) if os.path.isdir(one)), Path(os.sep))
    try:
        return shutil.disk_usage(nearest).free
    except OSError:
        return 0


def _of_the_server() -> str:
    """Advice for a server of the runs that does not respond properly."""
    if team := team_server():
        return f"{API_URL} names {team}: see there, or unset the variable"
    folder = server_folder() if _data_root() else None
    if folder is not None and (free := _free_space(folder)) <= ROOMY:
        return f"its disk has {free / 2**20:.0f} MiB left: make room in {folder}, or set DCAP_DATA to another disk"
    return f"its log is {folder / 'server.log'}" if folder else "see its log"


def _status(error: BaseException) -> int:
    """The status of a server's response; 0 for any other error."""
    status = getattr(getattr(error, "response", None), "status_code", 0) if _of_server(error) else 0
    return status if isinstance(status, int) else 0


def _knob_of_memory() -> str:
    return "close other programs, give fewer --workers, a coarser --resolution or smaller files"


@contextmanager
def pass_over_server_errors() -> Iterator[list[Exception]]:
    """Continue after errors of the server of the runs, where work can continue without its response.

    Yields a list that keeps an error by which the server is lost: it does not respond, or fails. A refusal, as for a
    run that somebody has deleted, is not such an error.
    """
    lost: list[Exception] = []
    try:
        yield lost
    except Exception as error:
        if is_lost_server(error):
            lost.append(error)
        elif not is_server_error(error):
            raise


def is_server_error(error: BaseException) -> bool:
    """Return whether an error is the server's: a loss or a refusal."""
    return is_lost_server(error) or _has_class_of(error, ANSWERS)


def is_lost_server(error: BaseException) -> bool:
    """Return whether an error means that the server of the runs does not respond, or fails."""
    return str(error).startswith(GIVEN_UP) or (_of_server(error) and _status(error) not in REFUSALS)


def _of_server(error: BaseException) -> bool:
    """Return whether an error comes from Prefect or from the connection to its server."""
    return (isinstance(error, RuntimeError) and NO_SERVER in str(error)) or _has_class_of(error, SERVER)


def _has_class_of(error: BaseException, packages: tuple[str, ...]) -> bool:
    return any(kind.__module__.partition(".")[0] in packages for kind in type(error).__mro__)


def _words(error: BaseException) -> str:
    """The message of an error in one line."""
    return shortened(" ".join(str(error).split()) or type(error).__name__, LONGEST_WORDS)
