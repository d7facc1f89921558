"""`dcap export --format splats`: the settled Gaussians of one finished placement, on demand."""

import os
import tempfile
from pathlib import Path

from dcap.scene.whole_files import DRAFTS
from flows.options import check_out
from flows.run_files import FinishedPlacement
from flows.scene_splats import SETTLED_SPLATS, settled_scene_splats, write_made


def write_settled_splats(placement: FinishedPlacement, folder: Path) -> Path:
    """Write scene_settled.ply into a folder; InputError where the scene has no Gaussians or nothing rests in it."""
    check_out(folder)
    made = settled_scene_splats(placement.finished, placement.values)
    folder.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=folder, prefix=DRAFTS) as draft:
        write_made(made, Path(draft))
        os.replace(Path(draft) / SETTLED_SPLATS, folder / SETTLED_SPLATS)
    return folder / SETTLED_SPLATS
