"""`view3d.html` of a run: the placements of a sample by all methods in three.js, without a server.

In: scene.glb of each placement. Out: the page, three.js once, and for each placement a script with its surface. A page
that is opened from disk may load scripts but not fetch files, so each surface is a script that hands over bytes: the
cut-out around the object as GLB, compressed, in base 64. A script is loaded when its sample is looked at.

three.js is that of the installed trimesh: nothing is downloaded, and we keep no copy. trimesh carries a page with all
of three.js and the reader of GLB in it, for notebooks; its last statement starts that page's own viewer. Without that
statement it is a library. three.js is under the MIT licence.
"""

import base64
import gzip
import json
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import cache
from pathlib import Path

from trimesh import resources, util

from dcap.evaluation.pages import TEMPLATES
from dcap.evaluation.study.attention import read_placed_surface
from dcap.evaluation.table_files import write_if_other
from dcap.scene.errors import DcapError
from dcap.scene.writers.placed_scene import copy_earlier, note_files
from dcap.scene.written_files import digest_of_file

ARCHIVED_PAGE, ARCHIVE, START = "viewer.html.template", "templates/viewer.zip", "init();"
ORBIT = TEMPLATES / "orbit.js"
"""Our script that shows models with it."""
NEEDED = ("THREE.GLTFLoader=", "WebGLRenderer")
PAGE, FOLDER = "view3d.html", "view3d"
SCENE = "scene.glb"
MOST_FACES = 40_000
"""Most faces of a cut-out [-]: a browser draws all methods side by side, and a run has a file for each placement."""
LEVEL = 6
"""Level of compression."""
FORMAT = 1
"""Version of the scripts, raised when the same scene.glb gives another script."""
AT_A_TIME = 2
"""Most placements that are read at once: each takes the memory of its whole scene."""


@cache
def three_script() -> str:
    """The library as one script; empty if the installed trimesh has no usable one: then only pictures are shown."""
    try:
        archive = util.decompress(resources.get_bytes(ARCHIVE), file_type="zip")
        page = archive[ARCHIVED_PAGE].read().decode("utf-8")  # type: ignore[union-attr]
    except (OSError, KeyError, ValueError, AttributeError):
        return ""
    script, _, _ = page.partition("<script>")[2].rpartition("</script>")
    if not script.rstrip().endswith(START) or not all(word in script for word in NEEDED):
        return ""
    return script.rstrip().removesuffix(START)


@dataclass(frozen=True, slots=True)
class ShownModel:
    """A placement on the page."""

    method: str
    name: str
    """The method's shown name."""
    folder: Path
    """Folder of the placement, with its scene.glb."""
    link: str
    """The folder relative to the run."""


def write_view3d(run: Path, samples: Mapping[str, tuple[str, Sequence[ShownModel]]]) -> dict[str, tuple[str, ...]]:
    """Write the page and its scripts into a run's folder.

    Args:
        run: its folder.
        samples: prompt and placements by the id of a sample, in the order of the page.

    Returns:
        Methods that can be shown, by sample; none if the installed trimesh has no three.js.
    """
    library = three_script()
    if not library:
        return {}
    folder = run / FOLDER
    every = [one for _, models in samples.values() for one in models]
    with ThreadPoolExecutor(AT_A_TIME) as pool:
        there = dict(zip(every, pool.map(lambda one: write_model(folder, one), every), strict=True))
    found, rows = {}, {}
    for sample, (prompt, models) in samples.items():
        shown = [one for one in models if there[one]]
        if shown:
            found[sample] = tuple(one.method for one in shown)
            rows[sample] = {"prompt": prompt, "models": [[one.method, one.name, one.link] for one in shown]}
    if found:
        write_if_other(folder / "three.js", library.encode())
        write_if_other(folder / "orbit.js", ORBIT.read_bytes())
        write_if_other(folder / "samples.js", f"window.dcapSamples = {json.dumps(rows)};\n".encode())
        write_if_other(run / PAGE, (TEMPLATES / PAGE).read_bytes())
    return found


def write_model(folder: Path, model: ShownModel) -> bool:
    """Write the script of a placement unless there is one for the same scene.glb; False if there is nothing to show."""
    source, path = model.folder / SCENE, folder / f"{model.link}.js"
    if not source.is_file():
        return False
    mark = f"// {FORMAT} {digest_of_file(source)}\n"
    if path.is_file():
        with path.open(encoding="utf-8") as file:
            if file.readline() == mark:
                return True
    key = f"view3d {model.link} {mark}"
    if copy_earlier(key, folder):
        return True
    try:
        surface = read_placed_surface(source).around_thing(MOST_FACES)
        data = gzip.compress(surface.glb(surface.best_direction()), LEVEL, mtime=0)
    except DcapError:
        return False
    path.parent.mkdir(parents=True, exist_ok=True)
    text = base64.b64encode(data).decode()
    write_if_other(path, f'{mark}window.dcapModel({json.dumps(model.link)}, "{text}");\n'.encode())
    note_files(key, folder, {"script": path.relative_to(folder).as_posix()})
    return True
