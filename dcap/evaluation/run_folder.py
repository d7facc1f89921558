"""Where a run keeps what came of a sample."""

from pathlib import Path

from dcap.evaluation.methods import DCAP, split_id

SAMPLES_FOLDER, METHODS_FOLDER = "samples", "methods"


def folder_name(sample_id: str) -> str:
    """A sample's id as the name of a folder; ids that differ in signs only may share it."""
    return "".join(c if c.isalnum() or c in "-_." else "_" for c in sample_id)


def sample_folder(run: Path, sample_id: str) -> Path:
    """Folder of one sample in a run; of `METHOD/ID` that of another method than DCAP."""
    return placement_folder(run, *split_id(sample_id))


def placement_folder(run: Path, method: str, sample: str) -> Path:
    """Folder of what a method made of a sample."""
    own = run if method == DCAP else run / METHODS_FOLDER / method
    return own / SAMPLES_FOLDER / folder_name(sample)
