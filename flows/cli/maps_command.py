"""`dcap maps`."""

import sys
from pathlib import Path
from typing import Annotated

import typer


def maps(
    run: Annotated[str, typer.Argument(help="Name or folder of a run, or 'last'; or a folder that `place` wrote.")],
    sample: Annotated[str | None, typer.Argument(help="Id of a sample of the run.")] = None,
    camera: Annotated[
        Path | None, typer.Option(metavar="FILE", help="camera.json (docs/formats.md); default: that of settled.png.")
    ] = None,
    over: Annotated[
        Path | None, typer.Option(metavar="PHOTO", help="Put the object into this photo of the camera's.")
    ] = None,
    out: Annotated[Path | None, typer.Option(help="Folder; default: maps in the sample's own.")] = None,
) -> int:
    """Write depth, normals, masks, contact, shadow and ids of a placement, pixel by pixel of one view."""
    from flows.maps_one import maps_of_sample, note_of

    folder = maps_of_sample(run, sample, camera, over, out)
    if note := note_of(folder):
        print(f"note: {note}", file=sys.stderr)
    print(folder)
    return 0
