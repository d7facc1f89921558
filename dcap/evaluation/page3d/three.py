"""three.js for our pages, from the installed trimesh: nothing is downloaded, and we keep no copy.

trimesh carries a page with all of three.js and the reader of GLB in it, for notebooks; its last statement starts that
page's own viewer. Without that statement it is a library. three.js is under the MIT licence.
"""

from functools import cache
from pathlib import Path

from trimesh import resources, util

PAGE, ARCHIVE, START = "viewer.html.template", "templates/viewer.zip", "init();"
ORBIT = Path(__file__).with_name("orbit.js")
"""Our script that shows models with it."""
NEEDED = ("THREE.GLTFLoader=", "WebGLRenderer")


@cache
def three_script() -> str:
    """The library as one script; empty if the installed trimesh has no usable one: then only pictures are shown."""
    try:
        archive = util.decompress(resources.get_bytes(ARCHIVE), file_type="zip")
        page = archive[PAGE].read().decode("utf-8")  # type: ignore[union-attr]
    except (OSError, KeyError, ValueError, AttributeError):
        return ""
    script, _, _ = page.partition("<script>")[2].rpartition("</script>")
    if not script.rstrip().endswith(START) or not all(word in script for word in NEEDED):
        return ""
    return script.rstrip().removesuffix(START)
