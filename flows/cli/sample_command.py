"""`dcap dataset sample`: a data set of placements for a folder of scenes."""

import json
import sys
from pathlib import Path
from typing import Annotated

import typer

from flows.cli.checks import Json, MaxCost, Model, Record, Replay, given
from flows.options import PlaceOptions
from flows.settings.own import effective_options

OWN = ("scenes", "objects", "out", "per_scene", "seed", "infeasible", "splits", "listed", "skip", "as_json")
"""Parameters that are not options of the stages."""


def dataset_sample(
    context: typer.Context,
    scenes: Annotated[Path, typer.Argument(help="Folder whose subfolders and meshes are scenes, or one scene.")],
    objects: Annotated[Path, typer.Option(metavar="FOLDER", help="Folder of meshes, named by what they are: mug.glb.")],
    per_scene: Annotated[int, typer.Option(help="Samples of each scene.")],
    seed: Annotated[int, typer.Option(min=0, help="Seed of every draw.")] = 0,
    out: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Default: data/runs/samples/NAME/samples.yaml.")
    ] = None,
    splits: Annotated[str, typer.Option(metavar="SHARES", help="By scene: train=0.8,val=0.1,test=0.1.")] = "",
    listed: Annotated[
        str, typer.Option("--scenes", metavar="LIST", help="Only these: names between commas, or a .txt file of names.")
    ] = "",
    infeasible: Annotated[float, typer.Option(help="Share of requests that ought to be refused.")] = 0.1,
    skip: Annotated[bool, typer.Option("--skip", help="Leave out what cannot be used, and say so.")] = False,
    language: Annotated[str, typer.Option(help="Who writes them: offline, anthropic, openai or replay.")] = "",
    model: Model = "",
    record: Record = "",
    replay: Replay = "",
    max_cost: MaxCost = None,
    up: Annotated[str, typer.Option(help="Up axis of the scene files: z, y, -y, -z or auto.")] = "auto",
    unit: Annotated[str, typer.Option(help="Length unit of the scene files: m, cm, mm, in or auto.")] = "auto",
    object_up: Annotated[str, typer.Option(help="Up axis of the object files: z, y, -y, -z or auto.")] = "auto",
    object_unit: Annotated[str, typer.Option(help="Length unit of the object files: m, cm, mm, in or auto.")] = "auto",
    as_json: Json = False,
) -> int:
    """Make a data set of placements (sentence, object, intended outcome) for a folder of scenes."""
    options = effective_options(PlaceOptions, given(context, *OWN))

    from dcap.scene.json_tree import object_to_json
    from flows.dataset_sample import SamplingOptions, sample_dataset

    sampling = SamplingOptions(per_scene, seed, infeasible, splits, listed, skip)
    made = sample_dataset(scenes, objects, out, sampling, options, quiet=as_json)
    for name, why in made.left_out.items():
        print(f"dcap: left out: {name}: {why.removeprefix(f'{name}: ')}", file=sys.stderr)
    for name, missed in made.misses.items():
        print(f"note: {name}: the embedded reader takes it otherwise: {missed}", file=sys.stderr)
    if as_json:
        print(json.dumps(object_to_json(made), indent=2, ensure_ascii=False))
        return 0
    share = 100.0 * made.read_back / made.samples
    print(f"{made.samples} samples in {made.scenes} scenes, {made.infeasible} of them to be refused")
    if made.splits:
        print("splits: " + ", ".join(f"{name} {count} scenes" for name, count in made.splits.items()))
    print(f"the embedded reader understands {made.read_back} of {made.samples} as meant ({share:.1f} %)")
    print(f"data set: {made.path}")
    return 0
