"""Maps of a camera that sees nothing of the object say so."""

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from flows.extra_output import note_of


@pytest.mark.parametrize(("level", "told"), [(0, True), (1, False)])
def test_an_empty_mask_is_told(tmp_path: Path, level: int, told: bool) -> None:
    mask = np.zeros((4, 4), np.uint8)
    mask[2, 2] = level
    Image.fromarray(mask).save(tmp_path / "object_mask.png")
    assert ("nothing of the object" in note_of(tmp_path)) is told
