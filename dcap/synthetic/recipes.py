"""Recipes of rooms and objects: the keys of their YAML files and how these are read (docs/formats.md).

A recipe names builders and the places of their pieces; builders are Python (dcap/synthetic/catalogue.py).
Lengths are in metres, angles in degrees, walls are named by the compass, x runs from west to east and y to the north.

Reads a YAML file of recipes into its model, or reports a mistake with its place.
"""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Annotated, Literal, Self, TypeVar

from pydantic import (
    GetPydanticSchema,
    NonNegativeFloat,
    NonNegativeInt,
    PositiveFloat,
    TypeAdapter,
    ValidationError,
    model_validator,
)
from ruamel.yaml import YAML
from ruamel.yaml.error import YAMLError

from dcap.scene.checks.findings import yaml_lines
from dcap.scene.errors import InputError, Place, short
from dcap.scene.settings import resource
from dcap.scene.text import did_you_mean
from dcap.synthetic.catalogue import PIECES
from dcap.synthetic.paint import Finish, Painter
from dcap.synthetic.scan import ScanDefects
from dcap.synthetic.schema import FIELD_TYPES, Color, PieceChoice, RecipeModel, check_known
from dcap.synthetic.shapes import Size

RECIPES = resource("data/recipes")
"""The embedded recipes: colors.yaml, objects.yaml, and a file per room in rooms/."""


T = TypeVar("T")
Compass = Literal["south", "east", "north", "west"]
SizeField = Annotated[Size, GetPydanticSchema(lambda _, handler: handler(FIELD_TYPES[Size]))]
FinishField = Annotated[Finish, GetPydanticSchema(lambda _, handler: handler(FIELD_TYPES[Finish]))]
PainterField = Annotated[Painter, GetPydanticSchema(lambda _, handler: handler(FIELD_TYPES[Painter]))]
PieceField = Annotated[PieceChoice, GetPydanticSchema(lambda _, handler: handler(PIECES))]


def check_file(path: Path, kind: type[T], palette: Mapping[str, object] | None = None) -> T:
    """The checked content of a file; raises InputError with file, line, key and value."""
    try:
        text = path.read_text(encoding="utf-8")
        tree: object = YAML(typ="safe", pure=True).load(text)
    except OSError as broken:
        raise InputError(f"{path}: cannot be read: {broken.strerror}") from broken
    except (YAMLError, ValueError, RecursionError) as broken:
        raise InputError(f"{path}: is not YAML: {' '.join(str(broken).split())}") from broken
    try:
        return TypeAdapter(kind).validate_python(tree, context=palette)
    except ValidationError as broken:
        place, what = _complaint(broken, tree)
        where = ".".join(str(step) for step in place)
        raise InputError(f"{path}:{yaml_lines(text)(place)}: {f'{where}: ' if where else ''}{what}") from broken


def _complaint(broken: ValidationError, tree: object) -> tuple[Place, str]:
    """Place and description of the first mistake."""
    first = broken.errors(include_url=False)[0]
    place = _in_tree(first["loc"], tree)
    if first["type"] == "missing":
        return place, f"key {first['loc'][-1]!r} is missing"
    if first["type"] == "value_error":
        return place, first["msg"].removeprefix("Value error, ")
    return place, f"{first['msg']} (got {short(first['input'])})"


def _in_tree(steps: Sequence[str | int], tree: object) -> Place:
    """The steps that are keys or indices of the tree; pydantic adds some for its own branches."""
    place: list[str | int] = []
    for step in steps:
        if isinstance(tree, Mapping):
            known = step in tree
        else:
            known = isinstance(tree, list) and isinstance(step, int) and step < len(tree)
        if known:
            tree = tree[step]  # type: ignore[index]
            place.append(step)
    return tuple(place)


class CurtainRecipe(RecipeModel):
    """The pair of curtains next to a window."""

    fabric: Color
    seed: NonNegativeInt


class DoorRecipe(RecipeModel):
    """A door."""

    wall: Compass
    along: NonNegativeFloat
    """Middle of the opening, along x or y [m]."""
    width: PositiveFloat
    height: PositiveFloat


class WindowRecipe(DoorRecipe):
    """A window."""

    sill: NonNegativeFloat
    """Height of the lower edge [m]."""
    curtains: CurtainRecipe | None = None


class FreePlace(RecipeModel):
    """Any place, with a rotation."""

    x: float
    y: float
    z: float = 0.0
    yaw_deg: float = 0.0


class FloorPlace(RecipeModel):
    """On the floor, moved inwards as far as it needs to clear the walls."""

    x: float
    y: float


class WallPlace(RecipeModel):
    """With the back to a wall."""

    wall: Compass
    along: float
    """Middle of the piece, along x or y [m]."""
    gap: float = 0.02
    """Gap between wall and back [m]."""
    z: float = 0.0


class UponPlace(RecipeModel):
    """On another thing, at a point of that thing's own frame."""

    thing: str
    """Name of an earlier thing in the list."""
    right: float = 0.0
    front: float = 0.0
    yaw_deg: float = 0.0
    top: PositiveFloat | None = None
    """Height of the support [m]; by default the highest point of the thing below."""
    board: NonNegativeInt | None = None
    """Instead of a height: a board of a shelf, counted from 0 at the bottom."""


class BookFill(RecipeModel):
    """Books on the boards of a shelf; the topmost board stays empty."""

    seed: NonNegativeInt
    free: tuple[NonNegativeInt, ...] = (2,)
    """Additional boards that stay empty."""


class ThingRecipe(RecipeModel):
    """A piece of furniture and its place, which is exactly one of `at`, `stand`, `against` and `upon`."""

    piece: PieceField
    name: str = ""
    """Name by which other things refer to it in `upon`."""
    varies: bool = False
    """Whether the room's seed is added to the piece's seed, so that it differs between datasets."""
    books: BookFill | None = None
    at: FreePlace | None = None
    stand: FloorPlace | None = None
    against: WallPlace | None = None
    upon: UponPlace | None = None

    @model_validator(mode="after")
    def _sound(self) -> Self:
        places = [self.at, self.stand, self.against, self.upon]
        if sum(one is not None for one in places) != 1:
            raise ValueError("expected exactly one of the keys at, stand, against, upon")
        if self.varies and "seed" not in self.piece.arguments:
            raise ValueError(f"varies: a {self.piece.name} has no seed")
        if self.books and self.piece.name != "bookshelf":
            raise ValueError("books: only a bookshelf has boards")
        return self


class RoomRecipe(RecipeModel):
    """A room."""

    kind: str
    """Room type as InteriorGS writes it."""
    seed: NonNegativeInt
    """Seed of everything random in it; rooms of one dataset differ if their seeds do."""
    size: SizeField
    """Inner width (x), depth (y) and height [m]."""
    wall: FinishField
    floor: PainterField
    windows: tuple[WindowRecipe, ...] = ()
    doors: tuple[DoorRecipe, ...] = ()
    things: tuple[ThingRecipe, ...] = ()
    """Things in order of placement; curtains and a ceiling lamp come last."""
    scan: ScanDefects = ScanDefects()

    @model_validator(mode="after")
    def _openings_fit(self) -> Self:
        width, depth, height = self.size
        for one in (*self.windows, *self.doors):
            length = width if one.wall in ("south", "north") else depth
            sill = one.sill if isinstance(one, WindowRecipe) else 0.0
            if not 0 < one.along - one.width / 2 < one.along + one.width / 2 < length or sill + one.height > height:
                raise ValueError(f"the opening at {one.along} m does not fit into the {one.wall} wall")
        return self

    @model_validator(mode="after")
    def _names_are_known(self) -> Self:
        named: dict[str, PieceChoice] = {}
        for thing in self.things:
            if thing.upon:
                check_known("thing", thing.upon.thing, named)
                _check_height(thing.upon, named[thing.upon.thing])
            if thing.name in named:
                raise ValueError(f"two things have the name {thing.name!r}")
            if thing.name:
                named[thing.name] = thing.piece
        return self


def _check_height(place: UponPlace, below: PieceChoice) -> None:
    """Raise ValueError for a board that a thing lacks, and for two heights."""
    boards = below.arguments.get("boards")
    count = boards if isinstance(boards, int) else 0
    if place.board is not None and place.top is not None:
        raise ValueError(f"upon {place.thing}: expected top or board, not both")
    if place.board is not None and place.board >= count:
        raise ValueError(f"upon {place.thing}: it has {count} boards; there is no board {place.board}")


class ObjectRecipe(RecipeModel):
    """A thing to place, standing on z = 0, its front towards +y."""

    piece: PieceField
    mass: PositiveFloat
    """Mass of the thing [kg]; informative, only for tests and people."""
    format: Literal["glb", "obj", "ply"] = "glb"
    """glb (named nodes, y up), obj or ply (one mesh, z up)."""
    unit: PositiveFloat = 1.0
    """Length of the file's unit [m]; like downloaded files, some files use an unusual unit."""
    fused: bool = False
    """Whether the solids of each part are united into one."""


def room_names(folder: Path = RECIPES) -> tuple[str, ...]:
    """Names of the rooms of a folder of recipes."""
    return tuple(sorted(path.stem for path in (folder / "rooms").glob("*.yaml")))


def room_recipe(name: str, folder: Path = RECIPES) -> RoomRecipe:
    """The recipe of one room; raises InputError with file, line, key and value."""
    names = room_names(folder)
    if name not in names:
        hint = did_you_mean(name, names) or f"; there are {', '.join(names) or 'none'}"
        raise InputError(f"{folder / 'rooms'}: no room is called {name!r}{hint}")
    return check_file(folder / "rooms" / f"{name}.yaml", RoomRecipe, palette(folder))


def object_recipes(folder: Path = RECIPES) -> Mapping[str, ObjectRecipe]:
    """The recipes of all objects by name; raises InputError with file, line, key and value."""
    return check_file(folder / "objects.yaml", dict[str, ObjectRecipe], palette(folder))


def palette(folder: Path = RECIPES) -> Mapping[str, object]:
    """Colours by name: the embedded ones, and those of a folder of recipes."""
    own = [one / "colors.yaml" for one in dict.fromkeys((RECIPES, folder))]
    return {name: color for path in own if path.exists() for name, color in check_file(path, dict[str, Color]).items()}
