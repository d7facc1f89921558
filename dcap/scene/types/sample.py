"""What a user asks for: a scene, an object and a sentence."""

from dataclasses import dataclass, field


@dataclass(frozen=True, slots=True)
class SourceOptions:
    """How to read a foreign file where the file itself does not say."""

    up: str = "auto"
    """Axis of the file that points up: y, z, -y, -z or auto."""
    unit: str = "auto"
    """Length unit: m, cm, mm, in or auto."""
    label: str = ""
    """Name for a whole mesh or for its unnamed nodes; empty: take names from the file."""


@dataclass(frozen=True, slots=True)
class Sample:
    """One placement to make."""

    id: str
    """Unique within a run, readable: bedroom_01-ball-center."""
    scene: str
    """Path of a folder or mesh file."""
    object: str
    """Path of a mesh file."""
    prompt: str
    """The instruction."""
    scene_options: SourceOptions = field(default_factory=SourceOptions)
    object_options: SourceOptions = field(default_factory=SourceOptions)
    mass: float | None = None
    """Overrides the mass prior [kg]."""
    seed: int = 0
