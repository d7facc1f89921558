"""Times of writing one placement, the embedded ball on its bed: pictures, maps, geometry and film.

python -m perf.pictures      seconds of each, and the ratio to one picture of the same view
"""

import tempfile
from collections.abc import Callable
from pathlib import Path

from rich.console import Console
from rich.table import Table

from dcap.geometry.rendering.picture import picture
from dcap.geometry.rendering.surface import PreparedMeshes
from dcap.scene.settings import data_root
from dcap.scene.types.choices import Anchor
from dcap.scene.types.segmentation import Segmentation, SegmentedObject, SegmentedScene
from dcap.scene.types.settled import Settled
from flows.extra_output import automatic_camera, write_film, write_maps_of
from flows.options import PlaceOptions
from flows.output import write_geometry
from flows.place_one import place_files
from flows.placement_json import Values
from flows.run_files import FinishedPlacement, finished_placement
from flows.selection import DATASET_SEED, ensure_dataset
from perf.stopwatch import best
from tasks.render.settled_meshes import painted_item, painted_scene, settled_scene, shown
from tasks.render.stage import render

ROOM, OBJECT, PROMPT = "bedroom_01", "ball", "put the ball at the center of the bed"
REPEATS = 3


def placement(folder: Path) -> FinishedPlacement:
    """The ball on the bed; its stages are computed if they are not in the cache."""
    root = ensure_dataset(data_root(), DATASET_SEED, rooms=[ROOM])
    scene, thing = root / "rooms" / ROOM, root / "objects" / f"{OBJECT}.glb"
    place_files(str(scene), str(thing), PROMPT, PlaceOptions(), folder, quiet=True)
    return finished_placement(str(folder), None)


def at_rest(values: Values) -> tuple[Segmentation, Segmentation, Anchor, Settled]:
    """Scene, object, anchor and rest state."""
    scene, item, anchor, settled = values.scene, values.item, values.anchor, values.settled
    if scene is None or item is None or anchor is None or settled is None:
        raise AssertionError(f"{PROMPT!r} in {ROOM} has no rest state: {values.infeasible}")
    return scene, item, anchor, settled


def one_picture(found: FinishedPlacement) -> Callable[[], object]:
    """Take `settled.png`."""
    values, config = found.values, found.config.render
    scene, item, anchor, settled = at_rest(values)
    camera = automatic_camera(values, config)
    around = settled_scene(scene, settled, anchor.base_id)
    thing = painted_item(item, anchor, settled.bodies[0], values.object_surface)
    meshes = [*shown(around.scene, camera, painted_scene(around, values.scene_surface)), thing]
    return lambda: picture(PreparedMeshes(meshes), camera, samples=config.samples)


def all_pictures(found: FinishedPlacement) -> Callable[[], object]:
    """Run the stage render."""
    values = found.values
    scene, item, anchor, settled = at_rest(values)
    given = SegmentedScene(scene), SegmentedObject(item), anchor, settled, values.scene_surface, values.object_surface
    return lambda: render(*given, config=found.config.render)


def table() -> Table:
    """Seconds of each."""
    shown_table = Table("of one placement", "s", "of one picture", box=None)
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        found = placement(folder)
        alone = best(one_picture(found), REPEATS)
        rows = {
            "settled.png": alone,
            "all pictures (the stage render)": best(all_pictures(found), REPEATS),
            "all maps of one view": best(lambda: write_maps_of(found, folder / "maps"), REPEATS),
            "object.glb, scene.glb, particles.parquet": best(lambda: write_geometry(found.values, folder), REPEATS),
            "drop.mp4": best(lambda: write_film(found, folder), REPEATS),
        }
    for what, each in rows.items():
        shown_table.add_row(what, f"{each:.2f}", f"{each / alone:.1f}")
    return shown_table


if __name__ == "__main__":
    Console(highlight=False, width=120).print(table())
