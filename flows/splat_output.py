"""`dcap export --format splats`: the settled Gaussians of one finished placement, on demand."""

import os
from pathlib import Path

from dcap.scene.whole_files import draft_folder
from flows.options import check_out
from flows.run_files import FinishedPlacement
from flows.scene_splats import SETTLED_SPLATS, settled_scene_splats, write_made


def write_settled_splats(placement: FinishedPlacement, folder: Path) -> Path:
    """Write scene_settled.ply into a folder; InputError where the scene has no Gaussians or nothing rests in it."""
    check_out(folder)
    made = settled_scene_splats(placement.finished, placement.values)
    with draft_folder(folder) as draft:
        write_made(made, draft)
        os.replace(draft / SETTLED_SPLATS, folder / SETTLED_SPLATS)
    return folder / SETTLED_SPLATS
