"""The command line: `dcap place|benchmark|plan|rerun|drop|report|diff|provenance|judge|maps|view|export|study|dataset|
cache|config|ui`.

Results go to standard output, everything else to standard error. Exit codes: 0 at rest or done, 2 bad input, 3
understood but infeasible, 4 some samples of a benchmark failed. An error that a user can mend is one line.
"""

import json
import sys
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from dcap.language.protocol.client import DEFAULT_MODEL
from dcap.scene.settings import runs_root, shared_store_url, version
from flows.cli.border import check_words, end_output, let_go, told
from flows.cli.checks import Json, given
from flows.cli.config_command import config_app
from flows.cli.data import cache_app, dataset_app
from flows.cli.diff_command import diff
from flows.cli.export_command import export
from flows.cli.judge_command import judge
from flows.cli.maps_command import maps
from flows.cli.provenance_command import provenance
from flows.cli.study_command import study_app
from flows.cli.view_command import view
from flows.cli.worker_command import worker
from flows.find_run import find_run
from flows.interrupts import INTERRUPTED, end_processes, say_interrupted
from flows.options import DropOptions, PlaceOptions, check_case, check_out, check_prompt
from flows.settings.own import effective_options, exported_paths, run_settings, server_settings

INFEASIBLE = 3
SOME_FAILED = 4
COMPUTING = frozenset({"place", "benchmark", "plan", "rerun", "drop"})
"""Commands that look results up or make them."""

app = typer.Typer(
    name="dcap",
    no_args_is_help=True,
    add_completion=False,
    rich_markup_mode=None,
    pretty_exceptions_enable=False,
)
app.add_typer(dataset_app, name="dataset")
app.add_typer(cache_app, name="cache")
app.add_typer(study_app, name="study")
app.add_typer(config_app, name="config")
app.command()(maps)
app.command()(judge)
app.command()(view)
app.command()(export)
app.command()(diff)
app.command()(provenance)
app.command()(worker)

Workers = Annotated[int, typer.Option(min=1, max=64, help="Samples to place in parallel.")]
Dataset = Annotated[Path | None, typer.Option(help="YAML list of samples; default: the embedded rooms.")]
Methods = Annotated[
    str, typer.Option(help="Comma-separated: dcap, fireplace, layoutgpt, holodeck, ablations by name, or all.")
]
Scenes = Annotated[
    str,
    typer.Option(metavar="LIST", help="Only these scenes: names between commas, a .txt file of names, or a split."),
]
Limit = Annotated[int | None, typer.Option(min=1, help="Only the first N samples.")]
Language = Annotated[
    str,
    typer.Option(help="Who reads the sentence: offline (default), anthropic, openai or replay.", show_default=False),
]
Model = Annotated[str, typer.Option(help="Model to ask; default: " + DEFAULT_MODEL + ".", show_default=False)]
Record = Annotated[
    str,
    typer.Option(metavar="DIR", help="Keep a copy of each reply in this folder, for --replay.", show_default=False),
]
Replay = Annotated[
    str, typer.Option(metavar="DIR", help="Answer from replies recorded in this folder.", show_default=False)
]
MaxCost = Annotated[float | None, typer.Option(help="Spend at most this on a model [USD].")]
Solver = Annotated[str, typer.Option(help="Method of the solver: tl or mls.")]
Arch = Annotated[
    str, typer.Option(help="Where the solver runs: cpu, cuda (a graphics card) or auto (cuda if it starts).")
]
Stability = Annotated[bool, typer.Option("--stability", help="Push what is at rest and grade how much it withstands.")]
LoadAware = Annotated[
    bool,
    typer.Option("--load-aware", help="Treat parts that give less than 0.05 mm under the load as rigid too."),
]
Ambiguous = Annotated[
    str, typer.Option(help="Where the sentence may mean several things: ask (and end) or take the best.")
]
PaperLimits = Annotated[
    bool,
    typer.Option("--paper-limits", help="Clamp materials to the paper's limits (E >= 5e4 Pa ...)."),
]
Resolution = Annotated[float | None, typer.Option(help="Cell size at the contact [m]; default: from the physics.")]
Threads = Annotated[int, typer.Option(min=0, help="Threads of the solver, 0: all cores; never changes a result.")]


def print_version(asked: bool) -> None:
    """Print the version and end."""
    if asked:
        print(f"dcap {version()}")
        raise typer.Exit


@app.callback()
def everything(
    context: typer.Context,
    version_asked: Annotated[
        bool, typer.Option("--version", callback=print_version, is_eager=True, help="Print the version and end.")
    ] = False,
) -> None:
    """Deformable, contact-aware placement: an object at rest in a scene, from a sentence."""
    context.with_resource(exported_paths())
    if shared_store_url() and context.invoked_subcommand in COMPUTING:
        from dcap.scene.store.artifacts import Store

        Store.default()  # once, rather than as an error of every sample


@app.command()
def place(
    context: typer.Context,
    scene: Annotated[
        str, typer.Argument(help="Folder (InteriorGS, ScanNet, SuGaR) or mesh (GLB, OBJ, PLY, STL, USD).")
    ],
    object: Annotated[str, typer.Argument(help="Mesh of the object.")],  # noqa: A002 the contract's name
    prompt: Annotated[str, typer.Argument(help='What to do: "put the ball at the centre of the bed".')],
    out: Annotated[Path | None, typer.Option(help="Folder for the results; default: data/runs/place.")] = None,
    language: Language = "",
    model: Model = "",
    record: Record = "",
    replay: Replay = "",
    max_cost: MaxCost = None,
    label: Annotated[str, typer.Option(help="What the scene mesh, or each of its unnamed nodes, is: table.")] = "",
    up: Annotated[str, typer.Option(help="Up axis of the scene file: z, y, -y, -z or auto.")] = "auto",
    unit: Annotated[str, typer.Option(help="Length unit of the scene file: m, cm, mm, in or auto.")] = "auto",
    height_of: Annotated[
        str,
        typer.Option(metavar="THING=METRES", help="Height of a thing, for a file of unknown scale: table=0.75."),
    ] = "",
    labels: Annotated[
        str,
        typer.Option(metavar="FILE", help="Names of the scene's things: labels.json, vertex ids, RoomPlan's JSON."),
    ] = "",
    at: Annotated[
        str, typer.Option(metavar="X,Y[,Z]", help="Point of the scene file's own frame that the object goes to.")
    ] = "",
    support: Annotated[
        str,
        typer.Option(metavar="X0,Y0,Z0,X1,Y1,Z1", help="Box of the scene file's own frame whose faces carry."),
    ] = "",
    object_label: Annotated[str, typer.Option(help="What the object is: mug.")] = "",
    object_up: Annotated[str, typer.Option(help="Up axis of the object file: z, y, -y, -z or auto.")] = "auto",
    object_unit: Annotated[str, typer.Option(help="Length unit of the object file: m, cm, mm, in or auto.")] = "auto",
    mass: Annotated[float | None, typer.Option(help="Mass of the object [kg]; default: a prior for its kind.")] = None,
    seed: Annotated[int, typer.Option(min=0, help="Seed of all random numbers.")] = 0,
    resolution: Resolution = None,
    threads: Threads = 0,
    solver: Solver = "tl",
    arch: Arch = "cpu",
    stability: Stability = False,
    load_aware: LoadAware = False,
    paper_limits: PaperLimits = False,
    ambiguous: Ambiguous = "ask",
    maps: Annotated[
        bool, typer.Option("--maps", help="Write conditioning maps, too: depth, normals, masks ...")
    ] = False,
    animate: Annotated[bool, typer.Option("--animate", help="Write a film of the drop, too: drop.mp4.")] = False,
    surface: Annotated[
        str, typer.Option(help="embedded (default) or iso: the surfaces around the material points, too: iso.glb.")
    ] = "embedded",
    as_json: Json = False,
) -> int:
    """Place one object in one scene."""
    options = effective_options(PlaceOptions, given(context, "scene", "object", "prompt", "as_json"))
    check_prompt(prompt)
    folder = options.out or runs_root() / "place"
    check_out(folder)

    from flows.output import result_line  # after the checks: the stages bring heavy libraries
    from flows.place_one import place_files

    tree = place_files(scene, object, prompt, options, folder, quiet=as_json)
    warnings = tree["warnings"]
    assert isinstance(warnings, list)
    for warning in warnings:
        print(f"note: {warning}", file=sys.stderr)
    print(json.dumps(tree, indent=2, ensure_ascii=False) if as_json else f"{result_line(tree)}\nresults: {folder}")
    return 0 if tree["verdict"] == "at_rest" else INFEASIBLE


@app.command()
def drop(
    context: typer.Context,
    case: Annotated[Path, typer.Argument(help="Case file: bodies, shapes, materials.")],
    out: Annotated[Path, typer.Option(help="Folder for the results.")],
    solver: Solver = "tl",
    resolution: Resolution = None,
    threads: Threads = 0,
    arch: Arch = "cpu",
    stability: Stability = False,
    load_aware: LoadAware = False,
    as_json: Json = False,
) -> int:
    """Physics only: settle the bodies of a case file."""
    options = effective_options(DropOptions, given(context, "case", "as_json"))
    check_case(case)
    check_out(out)

    from flows.drop_one import drop_case

    tree = drop_case(case, options, out, quiet=as_json)
    print(json.dumps(tree, indent=2) if as_json else f"{tree['verdict']}\nresults: {out}")
    return 0 if tree["verdict"] == "at_rest" else INFEASIBLE


@app.command()
def benchmark(
    context: typer.Context,
    dataset: Dataset = None,
    methods: Methods = "dcap",
    scenes: Scenes = "",
    limit: Limit = None,
    workers: Workers = 2,
    only_failed: Annotated[
        bool, typer.Option("--only-failed", help="Only samples that failed in the last run.")
    ] = False,
    language: Language = "",
    model: Model = "",
    record: Record = "",
    replay: Replay = "",
    max_cost: MaxCost = None,
    batch: Annotated[
        bool, typer.Option("--batch", help="Ask in batches: half the price, answers within minutes to a day.")
    ] = False,
    paper_limits: PaperLimits = False,
    ambiguous: Ambiguous = "best",
    runner: Annotated[
        str, typer.Option(help="Who places: local (threads of this program), dask, ray, or pool (workers).")
    ] = "local",
    cluster: Annotated[
        str, typer.Option(metavar="ADDRESS", help="A cluster of Dask or Ray that is there.", show_default=False)
    ] = "",
    as_json: Json = False,
) -> int:
    """Place every sample of a dataset by each method and report."""
    from dcap.evaluation.methods import methods_of
    from dcap.scene.json_tree import object_to_json
    from flows.benchmark import run_benchmark
    from flows.benchmark_config import benchmark_config, runner_of

    asked = run_settings(flags := given(context))
    config, asking = benchmark_config(flags, asked)
    chosen_methods, who = methods_of(asked.methods), runner_of(asked)
    run = run_benchmark(
        dataset,
        config,
        asking,
        limit=limit,
        workers=asked.workers,
        only_failed=only_failed,
        methods=chosen_methods,
        scenes=scenes,
        runner=who,
    )
    if as_json:
        print(json.dumps(object_to_json(run.summary), indent=2, ensure_ascii=False))
    return SOME_FAILED if run.failed else 0


@app.command()
def plan(
    context: typer.Context,
    dataset: Dataset = None,
    methods: Methods = "dcap",
    scenes: Scenes = "",
    limit: Limit = None,
    language: Language = "",
    model: Model = "",
    record: Record = "",
    replay: Replay = "",
    paper_limits: PaperLimits = False,
    ambiguous: Ambiguous = "best",
    stages: Annotated[bool, typer.Option("--stages", help="A line for each stage of each sample, too.")] = False,
    as_json: Json = False,
) -> int:
    """Show what a benchmark would run and why, without running anything."""
    from dcap.evaluation.methods import methods_of
    from dcap.scene.json_tree import to_json
    from flows.configure import configured, many_options
    from flows.language_options import language_of
    from flows.plan import plan_benchmark
    from tasks.arch import chosen_arch

    asked = run_settings(flags := given(context))
    asking = replace(language_of(asked), max_cost=None, batch=False)  # a plan asks nobody
    config = configured(many_options(flags), language=asking.config(plan=True), arch=chosen_arch(asked.arch))
    chosen_methods = methods_of(asked.methods)
    rows = plan_benchmark(
        dataset, config, limit=limit, methods=chosen_methods, scenes=scenes, stages=stages, to_stderr=as_json
    )
    if as_json:
        print(json.dumps(to_json(rows), indent=2, ensure_ascii=False))
    return 0


@app.command()
def rerun(
    run: Annotated[str, typer.Argument(help="Name or folder of a run, or 'last'.")],
    sample: Annotated[str, typer.Argument(help="Id of a sample.")],
    stage: Annotated[str, typer.Option(help="Stage to compute again.")],
    max_cost: MaxCost = None,
    as_json: Json = False,
) -> int:
    """Compute one stage of one sample again; later stages only where their inputs changed."""
    from flows.benchmark import rerun_sample
    from flows.output import result_line

    tree, page = rerun_sample(run, sample, stage, max_cost)
    print(json.dumps(tree, indent=2, ensure_ascii=False) if as_json else f"{result_line(tree)}\nreport: {page}")
    return 0 if tree["verdict"] == "at_rest" else INFEASIBLE


@app.command()
def report(run: Annotated[str, typer.Argument(help="Name or folder of a run, or 'last'.")]) -> int:
    """Write a run's HTML report again."""
    find_run(run)
    from flows.benchmark import rewrite_report

    print(rewrite_report(run))
    return 0


@app.command()
def ui(
    context: typer.Context,
    port: Annotated[int, typer.Option(min=1, max=65535, help="Port on this machine.")] = 4200,
) -> int:
    """Serve Prefect's pages over all runs until interrupted."""
    from flows.ui import serve_pages

    chosen = port if given(context) else server_settings().port
    serve_pages(chosen, lambda address: print(f"{address}  (stop with Ctrl-C)", flush=True))
    return 0


def main(arguments: list[str] | None = None) -> int:
    """Run a command line, default that of the process, and return the contract's exit code."""
    words = sys.argv[1:] if arguments is None else list(arguments)
    try:
        check_words(words)
        try:
            with typer.main.get_command(app).make_context("dcap", words) as context:
                code = int(context.command.invoke(context) or 0)
        except typer.Exit as finished:
            code = finished.exit_code
        end_output()
        return code
    except (KeyboardInterrupt, typer.Abort) as error:
        say_interrupted()
        let_go(error)
        return INTERRUPTED
    except Exception as error:
        return told(error)
    finally:
        end_processes()
