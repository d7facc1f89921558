"""An object is called by what a person, its file or its folder says, else by the sentence; never by an id."""

from pathlib import Path

import pytest

from dcap.language.offline.placing import object_name

HASH = "0a1b2c3d4e5f60718293a4b5c6d7e8f9"


@pytest.mark.parametrize(
    ("path", "prompt", "given", "name"),
    [
        (f"glbs/000-023/{HASH}.glb", "put the tennis ball on the bed", "", "tennis ball"),
        (f"glbs/000-023/{HASH}.glb", "put the tennis ball on the bed", "juggling_ball", "juggling ball"),
        (f"glbs/000-023/{HASH}.glb", "put it on the bed", "", "object"),
        (f"glbs/000-023/{HASH}.glb", "put the ball on the bed", HASH, "ball"),
        ("objects/B07XJ8C8F5.glb", "put the gizmo on the bed", "", "gizmo"),
        ("objects/plush_bear.glb", "put the toy on the bed", "", "plush bear"),
        ("my_mug/textured.obj", "put the cup on the desk", "", "my mug"),
        (f"{HASH}/textured.obj", "put the cup on the desk", "", "cup"),
    ],
)
def test_names(path: str, prompt: str, given: str, name: str):
    """In that order; a folder counts where the file is called what every mesh is called."""
    assert object_name(Path(path), prompt, given) == name
