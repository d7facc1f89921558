"""Where a run keeps what came of a sample."""

from pathlib import Path

SAMPLES_FOLDER = "samples"


def folder_name(sample_id: str) -> str:
    """A sample's id as the name of a folder; ids that differ in signs only may share it."""
    return "".join(c if c.isalnum() or c in "-_." else "_" for c in sample_id)


def sample_folder(run: Path, sample_id: str) -> Path:
    """Folder of one sample in a run."""
    return run / SAMPLES_FOLDER / folder_name(sample_id)
