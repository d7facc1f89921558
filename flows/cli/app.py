"""The command line: `dcap place|benchmark|paper|plan|rerun|drop|report|diff|provenance|judge|maps|view|export|study|
dataset|cache|config|language|ui|worker`.

Results go to standard output, everything else to standard error. Exit codes: 0 at rest or done, 2 bad input, 3
understood but infeasible, 4 some samples of a benchmark failed. An error that a user can fix is one line.
"""

import json
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated

import typer

from dcap.scene.errors import MachineError
from dcap.scene.settings import runs_root, shared_store_url, version
from flows.cli.border import check_words, end_output, report_error
from flows.cli.checks import Json, Run, Verbose, print_result, typed_flags, with_options
from flows.cli.data import cache_app, dataset_app
from flows.cli.results import diff, export, judge, maps, provenance, study_app, view
from flows.find_run import find_run
from flows.interrupts import INTERRUPTED, say_interrupted
from flows.options import (
    KEYS,
    AllSettings,
    BenchmarkOptions,
    DropOptions,
    PaperOptions,
    PlaceOptions,
    PlanOptions,
    RerunOptions,
    UiOptions,
    WorkerOptions,
    check_case,
    check_out,
    check_prompt,
    setting_of,
)
from flows.settings import exported_paths

__all__ = ["INTERRUPTED", "app", "main"]
INFEASIBLE = 3
SOME_FAILED = 4
COMPUTING = frozenset({"place", "benchmark", "paper", "plan", "rerun", "drop"})
"""Commands that look up or produce results."""
FLAGS = tuple(name for name in KEYS.values() if setting_of(AllSettings.model_fields[name]).is_flag)
"""Fields of `AllSettings` that are options of the command line."""

language_app = typer.Typer(help="Try a model.", no_args_is_help=True, rich_markup_mode=None)
config_app = typer.Typer(help="Settings and where they come from.", no_args_is_help=True, rich_markup_mode=None)
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
app.add_typer(language_app, name="language")
for command in (maps, judge, view, export, diff, provenance):
    app.command()(command)


def print_version(wanted: bool) -> None:
    """Print the version and end."""
    if wanted:
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
        from tasks.artifact import Store

        Store.default()  # once, rather than as an error of every sample


@app.command()
@with_options(PlaceOptions)
def place(
    scene: Annotated[
        str,
        typer.Argument(
            help="Folder (InteriorGS, ScanNet, SuGaR), mesh (GLB, OBJ, PLY, STL, USD), splats, points (PCD, XYZ, NPY)."
        ),
    ],
    object: Annotated[str, typer.Argument(help="Mesh, splats or points of the object.")],  # noqa: A002 the contract's name
    prompt: Annotated[str, typer.Argument(help='What to do: "put the ball at the centre of the bed".')],
    options: PlaceOptions,
    as_json: Json = False,
    verbose: Verbose = False,
) -> int:
    """Place one object in one scene."""
    check_prompt(prompt)
    folder = options.out or runs_root() / "place"
    check_out(folder)

    from flows.output import result_line  # after the checks: the stages bring heavy libraries
    from flows.place_one import place_files

    tree = place_files(scene, object, prompt, options, folder, quiet=as_json)
    if not as_json:
        print(result_line(tree), flush=True)
    for key in ("warnings", "notes") if verbose else ("warnings",):
        messages = tree[key]
        assert isinstance(messages, list)
        for message in messages:
            print(f"{key.removesuffix('s')}: {message}", file=sys.stderr)
    print_result(tree, f"results: {folder}", as_json=as_json)
    return exit_code(tree)


def exit_code(placement: Mapping[str, object]) -> int:
    """Return the exit code of a placement.json."""
    return 0 if placement["verdict"] in ("at_rest", "as_posed") else INFEASIBLE


@app.command()
@with_options(DropOptions)
def drop(
    case: Annotated[Path, typer.Argument(help="Case file: bodies, shapes, materials.")],
    out: Annotated[Path, typer.Option(help="Folder for the results.")],
    options: DropOptions,
    as_json: Json = False,
) -> int:
    """Physics only: settle the bodies of a case file."""
    check_case(case)
    check_out(out)

    from flows.place_one import drop_case

    tree = drop_case(case, options, out, quiet=as_json)
    print_result(tree, f"{tree['verdict']}\nresults: {out}", as_json=as_json)
    return 0 if tree["verdict"] == "at_rest" else INFEASIBLE


@app.command()
@with_options(BenchmarkOptions)
def benchmark(options: BenchmarkOptions, as_json: Json = False) -> int:
    """Place every sample of a dataset by each method and report."""
    from flows.benchmark_config import place_dataset

    run = place_dataset(options)
    print_result(run.summary, "", as_json=as_json)
    return SOME_FAILED if run.failed else 0


@app.command()
@with_options(PaperOptions)
def paper(options: PaperOptions, as_json: Json = False) -> int:
    """Evaluate a data set as the paper does: all methods, a judge, a study ready to serve, tables, figures, one
    page."""
    from dcap.scene.written_files import object_to_json
    from flows.paper import run_paper

    made = run_paper(options)
    tree = {**object_to_json(made.run.summary), "page": str(made.page), "study": made.study}
    print_result(tree, f"{made.study}\n{made.page}", as_json=as_json)
    return SOME_FAILED if made.run.failed else 0


@app.command()
@with_options(PlanOptions)
def plan(options: PlanOptions, as_json: Json = False) -> int:
    """Show what a benchmark would run and why, without running anything."""
    from dcap.evaluation.methods import methods_of
    from flows.configure import configured, language_options
    from flows.plan import plan_benchmark
    from tasks.arch import chosen_arch

    asking = language_options(options).config(plan=True)
    rows = plan_benchmark(
        options.dataset,
        configured(options, language=asking, arch=chosen_arch(options.arch)),
        limit=options.limit,
        methods=methods_of(options.methods),
        scenes=options.scenes,
        stages=options.stages,
        to_stderr=as_json,
    )
    print_result(rows, "", as_json=as_json)
    return 0


@app.command()
@with_options(RerunOptions)
def rerun(
    run: Run,
    sample: Annotated[str, typer.Argument(help="Id of a sample.")],
    options: RerunOptions,
    as_json: Json = False,
) -> int:
    """Compute one stage of one sample again; later stages only where their inputs changed."""
    from flows.benchmark import rerun_sample
    from flows.output import result_line

    tree, page = rerun_sample(run, sample, options.stage, options.max_cost)
    print_result(tree, f"{result_line(tree)}\nreport: {page}", as_json=as_json)
    return exit_code(tree)


@app.command()
def report(run: Run) -> int:
    """Write a run's HTML report again."""
    find_run(run)
    from flows.benchmark import rewrite_report

    print(rewrite_report(run))
    return 0


@app.command()
@with_options(UiOptions)
def ui(options: UiOptions) -> int:
    """Serve Prefect's pages over all runs until interrupted."""
    from flows.server import PORT, pages_of, prefect_server, wait_for_end

    with prefect_server(options.port, only_there=options.port != PORT) as url:
        print(f"{pages_of(url)}  (stop with Ctrl-C)", flush=True)
        wait_for_end(url)
    raise MachineError(f"the Prefect server {pages_of(url)} has ended")


@app.command()
@with_options(WorkerOptions)
def worker(options: WorkerOptions) -> int:
    """Serve the pool of a Prefect server, own or $PREFECT_API_URL's, until interrupted."""
    from flows.worker import serve_pool

    serve_pool(options.limit, lambda line: print(f"{line}  (stop with Ctrl-C)", flush=True))
    return 0


@language_app.callback()
def language() -> None:
    """Try a model."""  # with a callback `check` stays a word of its own


@language_app.command("check")
@with_options(PlaceOptions, "language", "model", "effort", "max_tokens", "reply_timeout", "max_cost")
def language_check(options: PlaceOptions) -> int:
    """Ask a model a dozen questions with known answers about an embedded room. Run it first with a new key."""
    from dcap.scene.settings import runs_root
    from flows.configure import language_options
    from flows.language_check import check_language, row_in_words, totals_in_words

    folder = runs_root() / "language-check"
    rows = check_language(language_options(options), folder, lambda row: print(row_in_words(row), flush=True))
    print(totals_in_words(rows))
    return 0


@config_app.callback()
def config() -> None:
    """Settings and where they come from."""  # with a callback `show` stays a word of its own


@config_app.command("show")
@with_options(AllSettings, *FLAGS)
def config_show(
    context: typer.Context,
    options: AllSettings,
    every: Annotated[bool, typer.Option("--all", help="The stages' settings that have their defaults, too.")] = False,
    as_json: Json = False,
) -> int:
    """Show the settings in force and where each came from: default, file, environment or flag, as if given to a
    command."""
    from flows.given_settings import Origin, section_of, settings_file
    from flows.settings import OWN, secrets, settings_in_force

    rows = settings_in_force(options, typed_flags(context))
    if not every:
        rows = [one for one in rows if one.origin is not Origin.DEFAULT or section_of(one.key) in OWN]
    file = settings_file()
    tree = {"file": str(file) if file else None, "settings": rows, "secrets": secrets()}
    lines = [f"# {file or 'no dcap.yaml'}"]
    lines += [
        f"{one.key} = {json.dumps(one.value, ensure_ascii=False)}  # {one.origin} {one.where}".rstrip() for one in rows
    ]
    lines += [f"# {name}: {state}" for name, state in secrets().items()]
    print_result(tree, "\n".join(lines), as_json=as_json)
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
    except (KeyboardInterrupt, typer.Abort):
        say_interrupted()
        return INTERRUPTED
    except Exception as error:
        return report_error(error)
