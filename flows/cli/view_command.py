"""`dcap view`."""

import sys
from pathlib import Path
from typing import Annotated

import typer

from dcap.scene.errors import InputError
from flows.options import PlaceOptions, check_prompt
from flows.settings.own import effective_options

THERE = "put it there"


def view(
    run: Annotated[
        str,
        typer.Argument(metavar="RUN|SCENE", help="Run, 'last', a folder that `place` wrote; or a scene to place in."),
    ],
    sample: Annotated[str | None, typer.Argument(help="Id of a sample of the run.")] = None,
    port: Annotated[
        int, typer.Option(min=1, max=65535, help="Port on this machine; the next free one if taken.")
    ] = 8080,
    frame: Annotated[
        int | None, typer.Option(min=0, help="Frame of the drop to begin with; default: the last.")
    ] = None,
    no_open: Annotated[bool, typer.Option("--no-open", help="Do not open a browser.")] = False,
    object: Annotated[  # noqa: A002 the contract's name
        str, typer.Option(metavar="FILE", help="Mesh that is placed where you click in SCENE.")
    ] = "",
    prompt: Annotated[str, typer.Option(metavar="TEXT", help="What to do with it.")] = THERE,
    out: Annotated[Path | None, typer.Option(help="Folder for that placement; default: data/runs/view.")] = None,
    label: Annotated[str, typer.Option(help="What the scene mesh, or each of its unnamed nodes, is.")] = "",
    up: Annotated[str, typer.Option(help="Up axis of the scene file: z, y, -y, -z or auto.")] = "auto",
    unit: Annotated[str, typer.Option(help="Length unit of the scene file: m, cm, mm, in or auto.")] = "auto",
    labels: Annotated[str, typer.Option(metavar="FILE", help="Names of the scene's things.")] = "",
    object_label: Annotated[str, typer.Option(help="What the object is: mug.")] = "",
    object_up: Annotated[str, typer.Option(help="Up axis of the object file.")] = "auto",
    object_unit: Annotated[str, typer.Option(help="Length unit of the object file.")] = "auto",
    mass: Annotated[float | None, typer.Option(help="Mass of the object [kg].")] = None,
) -> int:
    """Show a placement, or a scene to place something in, in the browser until interrupted."""
    options = effective_options(PlaceOptions, {
        "out": out, "label": label, "up": up, "unit": unit, "labels": labels, "object_label": object_label,
        "object_up": object_up, "object_unit": object_unit, "mass": mass,
    })  # fmt: skip
    check_prompt(prompt)

    from flows.view_one import ScenePrompt, ViewPage, is_placement, view_sample, view_scene

    page = ViewPage(port, not no_open, say_where)
    if not object and (sample is not None or is_placement(run) or not Path(run).exists()):
        view_sample(run, sample, frame, page)
        return 0
    if sample is not None:
        raise InputError(
            f"{sample!r} is a sample of a run, and --object {object} is for a scene: leave one of them out"
        )
    if object and not Path(object).is_file():
        raise InputError(f"--object {object}: no such file")
    if frame is not None:
        raise InputError(f"--frame {frame}: nothing is placed in {run} yet")
    view_scene(ScenePrompt(run, object, prompt, options), page)
    return 0


def say_where(url: str, note: str) -> None:
    """The page's address on standard output."""
    if note:
        print(f"dcap: {note}", file=sys.stderr)
    print(f"{url}  (stop with Ctrl-C)", flush=True)
