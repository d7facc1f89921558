"""Makes a dataset from its recipes: rooms, objects, and their truth in a separate folder, because no stage may read it.

FOLDER/rooms/NAME/ (InteriorGS layout), FOLDER/objects/NAME.glb|obj|ply, FOLDER/truth/NAME.parquet (face by face:
instance, label, part) and FOLDER/truth/recipes/ (the recipe of each). On demand FOLDER/splat_rooms/NAME/: the same
rooms in InteriorGS' original form, Gaussian splats instead of a mesh. Complete files from the same recipe are kept.

The things to place, by their recipes.
"""

import hashlib
import json
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq

from dcap.geometry.splatting import discs as splat_maker
from dcap.geometry.splatting.discs import splats_on_mesh
from dcap.scene.writers import gaussians as gaussians_write
from dcap.scene.writers import interiorgs as interiorgs_write
from dcap.scene.writers import meshes as ply_write
from dcap.scene.writers.interiorgs import write_interiorgs, write_interiorgs_splats
from dcap.scene.writers.meshes import write_object
from dcap.synthetic.recipes import RECIPES, ObjectRecipe, RoomRecipe, object_recipes, room_names, room_recipe
from dcap.synthetic.rooms import build_recipe
from dcap.synthetic.shapes import Assembly, joined, union

SPLAT_ROOMS = "splat_rooms"
"""Folder of the splat rooms."""

Maker = Callable[[], list[Path]]


def build_object(name: str) -> Assembly:
    """One of the embedded objects in its file's own unit, z up."""
    return in_file_unit(object_recipes()[name])


def in_file_unit(recipe: ObjectRecipe) -> Assembly:
    """The object of a recipe in its file's own unit, z up."""
    return in_metres(recipe).transformed(np.diag([1 / recipe.unit] * 3 + [1.0]))


def in_metres(recipe: ObjectRecipe) -> Assembly:
    """The object of a recipe, z up, standing on z = 0, front towards +y."""
    built = recipe.piece.build()
    return _fused(built) if recipe.fused else built


def _fused(item: Assembly) -> Assembly:
    """A copy in which the solids of each part are united."""
    return replace(item, parts=tuple(replace(p, solids=(union(p.solids),)) for p in item.parts))


def make_dataset(
    folder: Path,
    seed: int = 0,
    *,
    rooms: Sequence[str] = (),
    objects: Sequence[str] | None = None,
    splats: int = 0,
    scenes: int = 0,
    recipes: Path = RECIPES,
) -> None:
    """Write every room and object that is missing, damaged or was made by another recipe.

    `rooms` and `objects` select those to make; empty `rooms` and `objects` None mean all. With `splats` each room is
    also written as that number of Gaussians. `scenes` scenes are made from the rooms in turn, each round with the next
    seed; 0 makes one scene of each room. `recipes` is a folder like data/recipes; InputError names a mistake in it.
    """
    code = _digest_of(_sources())
    for name, room, own_seed in scenes_of(rooms or room_names(recipes), scenes, seed):
        recipe = room_recipe(room, recipes)
        made_from = f"{code} {recipe_digest(recipes, f'rooms/{room}.yaml')} {own_seed}"
        _keep_or_make(folder, f"rooms-{name}", made_from, partial(_write_room, folder, name, recipe, own_seed))
        if splats:
            make = partial(_write_splat_room, folder, name, recipe, own_seed, splats)
            _keep_or_make(folder, f"{SPLAT_ROOMS}-{name}", f"{made_from} {_splat_code_digest()} {splats}", make)
    known = object_recipes(recipes)
    made_from = f"{code} {recipe_digest(recipes, 'objects.yaml')}"
    for name in known if objects is None else objects:
        _keep_or_make(folder, f"objects-{name}", made_from, partial(_write_object, folder, name, known[name]))


def scenes_of(rooms: Sequence[str], scenes: int, seed: int) -> Iterator[tuple[str, str, int]]:
    """Name, room and seed of each scene: the first round has the names of the rooms, later names include the seed."""
    for number in range(scenes or len(rooms)):
        turn, place = divmod(number, len(rooms))
        yield (f"{rooms[place]}_seed_{seed + turn}" if turn else rooms[place]), rooms[place], seed + turn


def _sources() -> list[Path]:
    """Source files that determine the result of a recipe."""
    writers = [Path(str(one.__file__)) for one in (interiorgs_write, ply_write)]
    return [*sorted(Path(__file__).parent.rglob("*.py")), *writers]


def recipe_digest(recipes: Path, name: str) -> str:
    """Digest of a file of recipes and of the available colours."""
    files = (recipes / name, RECIPES / "colors.yaml", recipes / "colors.yaml")
    return _digest_of([path for path in dict.fromkeys(files) if path.exists()])


def _splat_code_digest() -> str:
    """Digest of the source that makes splats of a room."""
    return _digest_of([Path(str(splat_maker.__file__)), Path(str(gaussians_write.__file__))])


def _digest_of(sources: Sequence[Path]) -> str:
    return hashlib.sha256(b"\0".join(path.read_bytes() for path in sources)).hexdigest()


def _keep_or_make(folder: Path, name: str, recipe: str, make: Maker) -> None:
    """Run a maker unless its files exist, complete and from the same recipe."""
    note = folder / "truth" / "recipes" / f"{name}.json"
    if _is_whole(folder, note, recipe):
        return
    note.unlink(missing_ok=True)
    files = {path.relative_to(folder).as_posix(): _digest(path) for path in make()}
    note.parent.mkdir(parents=True, exist_ok=True)
    note.write_text(json.dumps({"recipe": recipe, "files": files}, indent=1) + "\n", encoding="utf-8")


def _is_whole(folder: Path, note: Path, recipe: str) -> bool:
    try:
        known = json.loads(note.read_text("utf-8"))
        return known["recipe"] == recipe and all(_digest(folder / name) == sha for name, sha in known["files"].items())
    except (OSError, ValueError, KeyError, TypeError, AttributeError):  # absent or damaged: make it again
        return False


def _digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def _write_room(folder: Path, name: str, recipe: RoomRecipe, seed: int) -> list[Path]:
    built = build_recipe(recipe, seed)
    files = write_interiorgs(folder / "rooms" / name, built.record, seed)
    table = pa.table(
        {
            "instance": pa.array([built.instance_ids[i] for i in built.face_instance]).dictionary_encode(),
            "label": pa.array([built.instance_labels[i] for i in built.face_instance]).dictionary_encode(),
            "part": pa.array(built.face_part.tolist()).dictionary_encode(),
        }
    )
    truth = folder / "truth" / f"{name}.parquet"
    truth.parent.mkdir(parents=True, exist_ok=True)
    pq.write_table(table, truth)
    return [*files, truth]


def _write_splat_room(folder: Path, name: str, recipe: RoomRecipe, seed: int, splats: int) -> list[Path]:
    """The room as splats, evenly distributed over its surface."""
    record = build_recipe(recipe, seed).record
    spacing = float(np.sqrt(record.mesh.face_areas.sum() / splats))
    made = splats_on_mesh(record.mesh, spacing, seed)
    return write_interiorgs_splats(folder / SPLAT_ROOMS / name, record, made, seed)


def _write_object(folder: Path, name: str, recipe: ObjectRecipe) -> list[Path]:
    path = folder / "objects" / f"{name}.{recipe.format}"
    write_object(path, [(part.name, joined(part.solids)) for part in in_file_unit(recipe).parts])
    return [path]
