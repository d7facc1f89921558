"""Commands about data: `dcap dataset make|label|check|sample|pack|prepare-sugar` and `dcap cache ls|du|gc|verify`."""

import sys
from pathlib import Path
from typing import Annotated

import typer

from dcap.scene.types.sample import SourceOptions
from flows.cli.checks import Json, PlacedRun, note, print_result, with_options
from flows.options import PlaceOptions, check_out

MOST_SCENES = 10_000
"""Most scenes to make at once; a larger number is taken for a typing error, since each takes about 5 MB."""
dataset_app = typer.Typer(help="Make the embedded dataset, or check any.", no_args_is_help=True, rich_markup_mode=None)
cache_app = typer.Typer(help="What has been computed.", no_args_is_help=True, rich_markup_mode=None)


@dataset_app.command("make")
def dataset_make(
    folder: Annotated[Path | None, typer.Option(help="Output folder; default: data/.")] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of rooms and objects.")] = 0,
    rooms: Annotated[str, typer.Option(help="Comma-separated names of the rooms to make; default: all.")] = "",
    splats: Annotated[
        int, typer.Option(min=0, max=4_000_000, help="Write each room as N Gaussian splats too, e.g. 500000.")
    ] = 0,
    scenes: Annotated[
        int,
        typer.Option(
            min=0, max=MOST_SCENES, help="Make N scenes of the rooms in turn, each round with the next seed, e.g. 186."
        ),
    ] = 0,
) -> int:
    """Generate the embedded rooms and objects where they are missing."""
    from dcap.scene.settings import data_root
    from flows.selection import ensure_dataset

    chosen = [name.strip() for name in rooms.split(",") if name.strip()]
    print(ensure_dataset(folder or data_root(), seed, rooms=chosen, splats=splats, scenes=scenes))
    return 0


@dataset_app.command("prepare-sugar")
@with_options(PlaceOptions, "up", "unit", "threads")
def dataset_prepare_sugar(
    scene: Annotated[Path, typer.Argument(help="Folder (InteriorGS, or one with splats) or PLY of Gaussian splats.")],
    out: Annotated[Path | None, typer.Option(help="Folder for the results; default: data/runs/sugar/NAME.")] = None,
    views: Annotated[int, typer.Option(min=1, max=20_000, help="Number of pictures; hundreds that overlap.")] = 300,
    width: Annotated[int, typer.Option(min=16, max=1920, help="Width of a picture [pixels].")] = 960,
    height: Annotated[int, typer.Option(min=16, max=1920, help="Height of a picture [pixels].")] = 720,
    *,
    options: PlaceOptions,
    seed: Annotated[int, typer.Option(min=0, help="Seed of the cameras' places.")] = 0,
    as_json: Json = False,
) -> int:
    """Render posed views of a scene of splats and write what SuGaR takes to make a mesh of them."""
    if out is not None:
        check_out(out)

    from dcap.geometry.splatting.camera_path import PathConfig
    from flows.prepare_sugar import prepare_sugar, summary

    config = PathConfig(views=views, width=width, height=height, seed=seed)
    folder, record = prepare_sugar(
        scene, out, SourceOptions(options.up, options.unit), config, threads=options.threads, quiet=as_json
    )
    print_result(record, summary(folder, record), as_json=as_json)
    return 0


@dataset_app.command("label")
@with_options(
    PlaceOptions, "language", "model", "effort", "max_tokens", "reply_timeout", "record", "replay", "max_cost", "label",
    "up", "unit", "height_of", "labels", "threads",
)  # fmt: skip
def dataset_label(
    scene: Annotated[str, typer.Argument(help="Folder (InteriorGS, ScanNet, SuGaR), mesh or Gaussian splats.")],
    options: PlaceOptions,
    out: Annotated[Path | None, typer.Option(help="Folder for the results; default: data/runs/labels/NAME.")] = None,
    as_json: Json = False,
) -> int:
    """Find the things of a scene and write labels.json with a page of numbered pictures, to correct by hand."""
    if out is not None:
        check_out(out)

    from flows.label_one import LABELS, PAGE, label_scene

    folder, tree = label_scene(scene, out, options, quiet=as_json)
    things = tree["things"]
    assert isinstance(things, list)
    where = f"{len(things)} things: {folder / LABELS}\npictures: {folder / PAGE}"
    print_result(tree, where, as_json=as_json)
    return 0


@dataset_app.command("sample")
@with_options(
    PlaceOptions, "language", "model", "effort", "max_tokens", "reply_timeout", "record", "replay", "max_cost", "up",
    "unit", "object_up", "object_unit",
)  # fmt: skip
def dataset_sample(
    scenes: Annotated[Path, typer.Argument(help="Folder whose subfolders and meshes are scenes, or one scene.")],
    objects: Annotated[Path, typer.Option(metavar="FOLDER", help="Folder of meshes, named by their kind: mug.glb.")],
    per_scene: Annotated[int, typer.Option(help="Samples of each scene.")],
    options: PlaceOptions,
    seed: Annotated[int, typer.Option(min=0, help="Seed of every draw.")] = 0,
    out: Annotated[
        Path | None, typer.Option(metavar="FILE", help="Default: data/runs/samples/NAME/samples.yaml.")
    ] = None,
    splits: Annotated[str, typer.Option(metavar="SHARES", help="By scene: train=0.8,val=0.1,test=0.1.")] = "",
    listed: Annotated[
        str,
        typer.Option("--scenes", metavar="LIST", help="Only these: comma-separated names, or a .txt file of names."),
    ] = "",
    infeasible: Annotated[float, typer.Option(help="Share of requests that ought to be refused.")] = 0.1,
    skip: Annotated[bool, typer.Option("--skip", help="Leave out unusable scenes and objects, and list them.")] = False,
    as_json: Json = False,
) -> int:
    """Make a data set of placements (sentence, object, intended outcome) for a folder of scenes."""
    from flows.dataset_sample import SamplingOptions, sample_dataset

    sampling = SamplingOptions(per_scene, seed, infeasible, splits, listed, skip)
    made = sample_dataset(scenes, objects, out, sampling, options, quiet=as_json)
    for name, why in made.left_out.items():
        note(f"left out: {name}: {why.removeprefix(f'{name}: ')}")
    for name, missed in made.misses.items():
        print(f"note: {name}: the embedded reader takes it otherwise: {missed}", file=sys.stderr)
    if as_json:
        print_result(made, "", as_json=True)
        return 0
    share = 100.0 * made.read_back / made.samples
    print(f"{made.samples} samples in {made.scenes} scenes, {made.infeasible} of them to be refused")
    if made.splits:
        print("splits: " + ", ".join(f"{name} {count} scenes" for name, count in made.splits.items()))
    print(f"the embedded reader understands {made.read_back} of {made.samples} as meant ({share:.1f} %)")
    print(f"data set: {made.path}")
    return 0


@dataset_app.command("check")
def dataset_check(
    path: Annotated[
        Path | None,
        typer.Argument(help="Dataset file (YAML), folder of scenes, scene or mesh; default: the embedded dataset."),
    ] = None,
    plot: Annotated[
        Path | None, typer.Option(help="Plot the deformable supports per scene to this file, .png or .svg.")
    ] = None,
    table: Annotated[
        Path | None, typer.Option(metavar="FILE.csv", help="Write the same numbers, one row a scene, to this file.")
    ] = None,
    as_json: Json = False,
) -> int:
    """List the problems of a dataset (of a mesh, splats or points the first error), and what its scenes hold; exit code
    2 if there are errors."""
    from dcap.evaluation.supports_plot import plot_suffix
    from flows.dataset_check import as_tree, check_dataset, in_words, write_plot, write_table

    if plot is not None:
        plot_suffix(plot)  # before a check that may take minutes
    report = check_dataset(path)
    print_result(as_tree(report), in_words(report), as_json=as_json)
    if plot is not None:
        write_plot(report, plot)
    if table is not None:
        write_table(report, table)
    return 2 if report.failed else 0


@dataset_app.command("pack")
def dataset_pack(
    run: PlacedRun,
    out: Annotated[
        Path | None, typer.Option(metavar="FILE.tar.gz", help="Default: dataset.tar.gz in the run's folder.")
    ] = None,
    as_json: Json = False,
) -> int:
    """Bundle a run for others: settled meshes, maps, prompts, placements, a manifest and the known licences."""
    from flows.dataset_pack import MANIFEST, README, pack_run

    pack = pack_run(run, out)
    for warning in pack.warnings:
        note(warning)
    counts = pack.manifest["counts"]
    assert isinstance(counts, dict)
    told = ", ".join(f"{number} {name.replace('_', ' ')}" for name, number in counts.items())
    where = f"{told}\n{pack.path} ({MANIFEST}, {README})"
    print_result(pack.manifest, where, as_json=as_json)
    return 0


@cache_app.command("ls")
def cache_ls(as_json: Json = False) -> int:
    """List the computed artifacts, by kind."""
    from flows.cli.cache_report import cache_listing

    return cache_listing(as_json=as_json)


@cache_app.command("du")
def cache_du(as_json: Json = False) -> int:
    """Tell what each stage has in the cache; what several share counts once."""
    from flows.cli.cache_report import cache_sizes

    return cache_sizes(as_json=as_json)


@cache_app.command("gc")
def cache_gc(
    yes: Annotated[bool, typer.Option("--yes", help="Delete it; without, only say what would go.")] = False,
    older_than: Annotated[
        float, typer.Option(min=0.0, metavar="DAYS", help="Keep younger artifacts, and everything they were made from.")
    ] = 1.0,
    keep: Annotated[
        list[Path] | None,
        typer.Option(metavar="DIR", help="A run or placement elsewhere that is kept, too."),
    ] = None,
    as_json: Json = False,
) -> int:
    """Find artifacts that no run below data/runs needs any more, and delete it with --yes."""
    from flows.cli.cache_report import cache_collection

    return cache_collection(older_than, keep or [], delete_it=yes, as_json=as_json)


@cache_app.command("verify")
def cache_verify(
    repair: Annotated[bool, typer.Option("--repair", help="Delete what is damaged.")] = False,
    as_json: Json = False,
) -> int:
    """Read every record and artifact; exit code 4 if some are damaged and stay. They are computed again when needed."""
    from flows.cli.cache_report import cache_verification

    return cache_verification(repair_it=repair, as_json=as_json)
