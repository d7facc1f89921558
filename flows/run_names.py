"""Tags and names of runs on Prefect's pages."""

from collections.abc import Sequence
from pathlib import Path

from dcap.scene.readers.scenes.sugar import MESH_SUFFIXES
from dcap.scene.types.sample import Sample

LONGEST = 200
"""Longest name or tag on a page [characters]."""


def sample_tags(sample: Sample, run: str = "") -> tuple[str, ...]:
    """Return the tags of a sample's task run and of its stages."""
    named = ("run", run), ("method", sample.method), ("scene", plain_name(sample.scene))
    return tuple(shorten(f"{key}:{value}") for key, value in named if value)


def benchmark_tags(run: str, methods: Sequence[str]) -> tuple[str, ...]:
    """Return the tags of a benchmark's flow run."""
    return (shorten(f"run:{run}"), *(f"method:{method}" for method in methods))


def plain_name(path: str) -> str:
    """Return the name of a file or folder, without a suffix or name that only says that it is a mesh."""
    last = Path(path)
    return last.stem if last.suffix.lower() in MESH_SUFFIXES else last.name


def shorten(text: str) -> str:
    """Return a name shortened to fit a line."""
    line = " ".join("".join(one if one.isprintable() else " " for one in text).split())
    return line if len(line) <= LONGEST else f"{line[: LONGEST - 1]}…"
