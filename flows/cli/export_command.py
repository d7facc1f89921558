"""`dcap export`."""

from pathlib import Path
from typing import Annotated

import typer


def export(
    run: Annotated[str, typer.Argument(help="Name or folder of a run, or 'last'; or a folder that `place` wrote.")],
    sample: Annotated[str | None, typer.Argument(help="Id of a sample of the run.")] = None,
    format: Annotated[  # noqa: A002 the contract's name
        str, typer.Option(metavar="NAME", help="mjcf (MuJoCo), urdf, usd, or splats (the Gaussians).")
    ] = "",
    out: Annotated[Path | None, typer.Option(help="Folder; default: export/FORMAT in the sample's own.")] = None,
) -> int:
    """Write the settled scene for a simulator, or as Gaussians."""
    from flows.export_one import export_sample

    print(export_sample(run, sample, format, out))
    return 0
