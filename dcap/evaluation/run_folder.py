"""Folders of the samples in a run."""

import hashlib
import re
import unicodedata
from pathlib import Path

from dcap.evaluation.methods import DCAP, split_id

SAMPLES_FOLDER, METHODS_FOLDER = "samples", "methods"
LONGEST = 120
"""Longest name of a folder [bytes]: file systems take 255, and drafts and archives add a prefix or suffix."""
MARK = 16
"""Hexadecimal digits of the digest that ends a shortened name: two of billions of ids may clash."""
DEVICES = re.compile(r"(?i)(con|prn|aux|nul|com[0-9\u00b9\u00b2\u00b3]|lpt[0-9\u00b9\u00b2\u00b3])(\.|$)")
"""Names that mean devices on Windows, whatever follows their first dot."""


def folder_name(sample_id: str) -> str:
    """A sample's id as the name of a folder on any file system; ids that differ in signs only may share it.

    An id that is too long for a name keeps its beginning and gets its digest.
    """
    name = "".join(c if c.isalnum() or c in "-_." else "_" for c in sample_id)
    if name.startswith(("-", ".")) or DEVICES.match(name):  # an option, a hidden folder, a device
        name = f"_{name[1:]}" if name.startswith(("-", ".")) else f"_{name}"
    if name.endswith("."):  # Windows drops it
        name = f"{name[:-1]}_"
    if len(name.encode()) <= LONGEST:
        return name
    digest = hashlib.sha256(sample_id.encode(errors="surrogatepass")).hexdigest()[:MARK]
    return f"{name.encode()[: LONGEST - MARK - 1].decode(errors='ignore')}-{digest}"


def same_folder(name: str) -> str:
    """Key of a folder's name, equal for names that differ only in case or the composition of letters."""
    return unicodedata.normalize("NFKC", unicodedata.normalize("NFKC", name).casefold())


def sample_folder(run: Path, sample_id: str) -> Path:
    """Folder of one sample in a run; `METHOD/ID` is a sample of another method than DCAP."""
    return placement_folder(run, *split_id(sample_id))


def placement_folder(run: Path, method: str, sample: str) -> Path:
    """Folder of a method's placement of a sample."""
    own = run if method == DCAP else run / METHODS_FOLDER / method
    return own / SAMPLES_FOLDER / folder_name(sample)
