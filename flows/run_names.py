"""How a benchmark and its samples are named and tagged where they are watched."""

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from uuid import UUID

from dcap.scene.readers.scenes.sugar import MESH_SUFFIXES
from dcap.scene.types.sample import Sample

LONGEST = 200
"""Letters of a name or tag that are shown."""


@dataclass(frozen=True, slots=True)
class WatchedRun:
    """A run as it is watched: its flow run has those of its samples as children."""

    name: str
    id: UUID | None = None
    """None if samples are placed in flow runs of their own."""
    repeated: frozenset[str] = frozenset()
    """Titles that several samples have."""

    def title(self, sample: Sample) -> str:
        """Name of a sample's flow run: method, room and object, and the sample's own name where it needs that."""
        name = title_of(sample)
        return shown(f"{name} / {sample.id}") if name in self.repeated else name


def title_of(sample: Sample) -> str:
    """Method, room and object."""
    return shown(" / ".join((sample.method, plain_name(sample.scene), plain_name(sample.object))))


def repeated_titles(samples: Sequence[Sample]) -> frozenset[str]:
    """Titles that several samples have."""
    return frozenset(title for title, count in Counter(map(title_of, samples)).items() if count > 1)


def sample_tags(sample: Sample, run: str = "") -> tuple[str, ...]:
    """Tags of a sample's flow run and of its task runs."""
    named = ("run", run), ("method", sample.method), ("scene", plain_name(sample.scene))
    return tuple(shown(f"{key}:{value}") for key, value in named if value)


def scene_tags(sample: Sample) -> tuple[str, ...]:
    """Tags of a flow run that only reads a scene."""
    return (shown(f"scene:{plain_name(sample.scene)}"),)


def benchmark_tags(run: str, methods: Sequence[str]) -> tuple[str, ...]:
    """Tags of a benchmark's flow run."""
    return (shown(f"run:{run}"), *(f"method:{method}" for method in methods))


def plain_name(path: str) -> str:
    """Name of a file or folder, without what only says that it is a mesh."""
    last = Path(path)
    return last.stem if last.suffix.lower() in MESH_SUFFIXES else last.name


def shown(text: str) -> str:
    """A name that fits in a line."""
    line = " ".join("".join(one if one.isprintable() else " " for one in text).split())
    return line if len(line) <= LONGEST else f"{line[: LONGEST - 1]}…"
