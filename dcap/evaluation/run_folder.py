"""Folders of the samples in a run, and its counts for summary.json and the head of its report."""

import hashlib
import re
import unicodedata
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from dcap.evaluation.methods import DCAP, split_id
from dcap.evaluation.outcome_table import AS_POSED, AT_REST, SampleOutcome
from dcap.language.model.ledger import Spending

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


@dataclass(frozen=True, slots=True)
class RunSummary:
    """Counts of samples, times, and the use of a model; summary.json has these keys in this order."""

    run: str
    """Folder of the run."""
    samples: int
    at_rest: int
    as_posed: int
    """Placements of methods that do not simulate."""
    infeasible: int
    failed: int
    """Samples with an error; neither at rest nor infeasible."""
    region_missed: int
    """Samples at rest outside of the requested region."""
    feasible_intended: int
    feasible_as_intended: int
    """Of these, the samples at rest as intended."""
    infeasible_intended: int
    infeasible_with_right_reason: int
    """Of these, the samples that are infeasible for the intended reason."""
    compute_s: float
    """Sum of the stages' times when they were computed [s]."""
    wall_s: float
    """Duration of the run [s]."""
    language: Spending | None = None
    """Number of questions and spending; None if no model was asked."""


def summary_of(
    rows: Sequence[SampleOutcome], *, run: str, wall_s: float, language: Spending | None = None
) -> RunSummary:
    """The counts of a run's samples; `wall_s` is the duration of the run [s]."""
    feasible = [row for row in rows if row.feasible_intended is True]
    infeasible = [row for row in rows if row.feasible_intended is False]
    return RunSummary(
        run=run,
        samples=len(rows),
        at_rest=sum(row.verdict == AT_REST for row in rows),
        as_posed=sum(row.verdict == AS_POSED for row in rows),
        infeasible=sum(row.verdict == "infeasible" for row in rows),
        failed=sum(row.error != "" for row in rows),
        region_missed=sum(row.verdict == AT_REST and row.region_missed for row in rows),
        feasible_intended=len(feasible),
        feasible_as_intended=sum(bool(row.as_expected) for row in feasible),
        infeasible_intended=len(infeasible),
        infeasible_with_right_reason=sum(bool(row.as_expected) for row in infeasible),
        compute_s=round(sum(row.seconds for row in rows), 1),
        wall_s=round(wall_s, 1),
        language=language,
    )
