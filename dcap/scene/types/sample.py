"""A user's request: a scene, an object and a sentence."""

from dataclasses import dataclass, field


@dataclass(frozen=True, slots=True)
class SourceOptions:
    """Frame and names of a foreign file that does not state them itself."""

    up: str = "auto"
    """Axis of the file that points up: y, z, -y, -z or auto."""
    unit: str = "auto"
    """Length unit: m, cm, mm, in or auto; or its length in metres; or any: initially the one that gives the size of a
    room."""
    label: str = ""
    """Name for a whole mesh or for its unnamed nodes; empty: take names from the file."""


@dataclass(frozen=True, slots=True)
class GivenPlace:
    """Place or support of the object in the scene file's own frame and unit; exactly one of the two is given."""

    at: tuple[float, ...] = ()
    """x, y, z of a point; or the two horizontal coordinates, for the highest surface there."""
    support: tuple[float, ...] = ()
    """Lowest and highest corner, x0, y0, z0, x1, y1, z1, of a box whose faces carry the object."""


@dataclass(frozen=True, slots=True)
class KnownHeight:
    """Known height of a thing in the scene, which determines the scale of a file without a unit."""

    thing: str
    """Kind of thing: table."""
    height: float
    """Height of the thing's main surface above the floor [m]."""


@dataclass(frozen=True, slots=True)
class Sample:
    """One placement to make."""

    id: str
    """Readable id, unique within a run: bedroom_01-ball-center."""
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
    labels: str = ""
    """Path of a file that names the scene's things; empty if there is none."""
    place: GivenPlace | None = None
    """A point or a box of the scene that determines the object's place."""
    known_height: KnownHeight | None = None
    """Known height that determines the scene's scale."""
    method: str = "dcap"
    """Method of placement (dcap/evaluation/methods.py)."""
    examples: tuple[str, ...] = ()
    """Paths of other scenes from which a method may learn, read with the same options; empty if it needs none."""
