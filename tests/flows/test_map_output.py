"""Where maps are written nothing else is touched; photos are read as people see them."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from dcap.geometry.rendering.map_files import FILES
from dcap.scene.errors import InputError
from flows.extra_output import clear_maps, read_photo


def test_only_maps_are_cleared(tmp_path: Path) -> None:
    folder = tmp_path / "maps"
    for name in FILES:
        (folder / name).parent.mkdir(parents=True, exist_ok=True)
        (folder / name).write_text("")
    (folder / "thesis.txt").write_text("mine")
    clear_maps(folder)
    assert [path.name for path in folder.iterdir()] == ["thesis.txt"]
    (folder / "thesis.txt").unlink()
    clear_maps(folder)
    assert not folder.exists()
    clear_maps(folder)


def test_photo_is_turned_as_its_data_say(tmp_path: Path) -> None:
    """Orientation 6: the camera was held upright; the first row of the file is the right side of the picture."""
    photo = Image.fromarray(np.tile(np.arange(60, dtype=np.uint8)[None, :, None], (40, 1, 3)))
    exif = Image.Exif()
    exif[0x0112] = 6
    photo.save(tmp_path / "upright.png", exif=exif)
    assert read_photo(tmp_path / "upright.png").shape == (60, 40, 3)
    photo.save(tmp_path / "plain.png")
    assert read_photo(tmp_path / "plain.png").shape == (40, 60, 3)


def test_photos_that_cannot_be_used(tmp_path: Path) -> None:
    Image.fromarray(np.full((4, 4), 40000, dtype=np.uint16)).save(tmp_path / "deep.png")
    with pytest.raises(InputError, match="8 bits"):
        read_photo(tmp_path / "deep.png")
    with pytest.raises(InputError, match="no such file"):
        read_photo(tmp_path / "none.png")
