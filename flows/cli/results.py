"""Commands about finished results: `dcap judge|diff|provenance|maps|export|view`, `dcap study serve|report`."""

import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated

import typer

from dcap.scene.errors import InputError
from flows.cli.checks import Json, PlacedRun, Run, Sample, note, print_result, with_options
from flows.find_run import find_run
from flows.options import JudgeOptions, PlaceOptions, check_prompt
from flows.own_requests import LOOPBACK, origin_of

study_app = typer.Typer(no_args_is_help=True, help="A study in which people compare the methods of a run.")


@with_options(JudgeOptions)
def judge(
    run: Annotated[str | None, typer.Argument(help="Name or folder of a run of several methods, or 'last'.")] = None,
    validate: Annotated[
        bool,
        typer.Option("--validate", help="Ask about pairs with known answers instead, and say how many are right."),
    ] = False,
    *,
    options: JudgeOptions,
) -> int:
    """Score and compare the methods of a run, and write the table; or tell how good a judge is."""
    if run is None and not validate:
        raise InputError("name the run to judge, or 'last'; without one there is --validate")
    if run is not None:
        find_run(run)
    from dcap.evaluation.method_report import shown_lines
    from flows.benchmark import rewrite_page
    from flows.configure import language_options
    from flows.judge_run import judge_run, validate_judge

    if validate:
        found = validate_judge(run, language_options(options), note)
        print(f"{found.accuracy.in_words}\n{found.path}")
        return 0
    assert run is not None
    judged = judge_run(run, language_options(options), note)
    print("\n".join(shown_lines(judged.table)))
    print(f"{judged.csv}\nreport: {rewrite_page(judged.folder, judged.rows)}")
    return 0


def diff(
    one: PlacedRun,
    other: Annotated[str, typer.Argument(metavar="RUN", help="Run to compare it with.")],
    times: Annotated[bool, typer.Option("--times", help="Show times, too; they are no difference.")] = False,
    as_json: Json = False,
) -> int:
    """Compare verdicts, poses, metrics, settings and versions of two runs."""
    from dcap.scene.written_files import object_to_json
    from flows.diff import diff_folders, difference_lines

    found = diff_folders(one, other)
    tree = {"equal": found.equal, **object_to_json(found)} if as_json else {}
    if not times:
        tree.pop("times", None)
    same = ["no difference"] if found.equal else []
    lines = [f"a: {found.a}", f"b: {found.b}", *same, *difference_lines(found, times=times)]
    print_result(tree, "\n".join(lines), as_json=as_json)
    return 0


def provenance(
    artifact: Annotated[
        str, typer.Argument(help="File or folder of a sample of a run, path in the store, or an artifact's digest.")
    ],
    as_json: Json = False,
) -> int:
    """Walk back from a result to its inputs: stages, settings, code, versions, seeds, prompts and hashes."""
    from flows.provenance import provenance_lines, provenance_of

    found = provenance_of(artifact)
    print_result(found, "\n".join(provenance_lines(found)), as_json=as_json)
    return 0


def maps(
    run: PlacedRun,
    sample: Sample = None,
    camera: Annotated[
        Path | None, typer.Option(metavar="FILE", help="camera.json (docs/formats.md); default: that of settled.png.")
    ] = None,
    over: Annotated[
        Path | None, typer.Option(metavar="PHOTO", help="Put the object into this photo of the camera's.")
    ] = None,
    out: Annotated[Path | None, typer.Option(help="Folder; default: maps in the sample's own.")] = None,
) -> int:
    """Write depth, normals, masks, contact, shadow and ids of a placement, pixel by pixel of one view."""
    from flows.extra_output import maps_of_sample, note_of

    folder = maps_of_sample(run, sample, camera, over, out)
    if warning := note_of(folder):
        print(f"note: {warning}", file=sys.stderr)
    print(folder)
    return 0


def export(
    run: PlacedRun,
    sample: Sample = None,
    format: Annotated[  # noqa: A002 the contract's name
        str, typer.Option(metavar="NAME", help="mjcf (MuJoCo), urdf, usd, or splats (the Gaussians).")
    ] = "",
    out: Annotated[Path | None, typer.Option(help="Folder; default: export/FORMAT in the sample's own.")] = None,
) -> int:
    """Write the settled scene for a simulator, or as Gaussians."""
    from flows.extra_output import export_sample

    print(export_sample(run, sample, format, out))
    return 0


@with_options(PlaceOptions, "out", "label", "up", "unit", "labels", "object_label", "object_up", "object_unit", "mass")
def view(
    run: Annotated[
        str,
        typer.Argument(metavar="RUN|SCENE", help="Run, 'last', a folder that `place` wrote; or a scene to place in."),
    ],
    sample: Sample = None,
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
    prompt: Annotated[str, typer.Option(metavar="TEXT", help="What to do with it.")] = "put it there",
    out: Annotated[Path | None, typer.Option(help="Folder for that placement; default: data/runs/view.")] = None,
    *,
    options: PlaceOptions,
) -> int:
    """Show a placement, or a scene to place something in, in the browser until interrupted."""
    check_prompt(prompt)

    from flows.view_one import ScenePrompt, ViewPage, is_placement, view_sample, view_scene

    page = ViewPage(port, not no_open, announce_page)
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


def announce_page(url: str, warning: str) -> None:
    """Print the page's address on standard output."""
    if warning:
        note(warning)
    print(f"{url}  (stop with Ctrl-C)", flush=True)


@study_app.command("serve")
def study_serve(
    run: Run,
    port: Annotated[int, typer.Option(min=1, max=65535, help="Port to listen on.")] = 8090,
    host: Annotated[str, typer.Option(help="Address to listen on; default: this machine alone.")] = LOOPBACK,
    raters: Annotated[int | None, typer.Option(min=1, max=999, help="At least so many raters; default: 1.")] = None,
    pairs: Annotated[
        int | None, typer.Option(min=1, max=10_000, help="Comparisons per rater; default: 40, if there are so many.")
    ] = None,
    seed: Annotated[
        int | None, typer.Option(min=0, help="Seed of pairs, sides and order; default: 0.", show_default=False)
    ] = None,
    ask_overall: Annotated[
        bool | None,
        typer.Option(
            "--ask-overall",
            help="Ask a third question, which of the two is better overall; default: a composite.",
            show_default=False,
        ),
    ] = None,
    url: Annotated[
        str,
        typer.Option(metavar="ADDRESS", help="https://NAME of a web server that stands before it.", show_default=False),
    ] = "",
) -> int:
    """Serve the comparisons of a run's methods to raters until interrupted; prints a secret link for each."""
    if not host.strip():
        raise InputError("--host: name an address to listen on, such as 127.0.0.1")
    check_url(url)
    find_run(run)
    from flows.study.serve import StudyOptions, serve_study

    serve_study(run, StudyOptions(host, port, raters, pairs, seed, ask_overall, url), note, announce)
    return 0


def check_url(url: str) -> None:
    """Raise InputError for a URL that is not the root of a web server."""
    try:
        if url:
            origin_of(url)
    except ValueError as error:
        text = f"--url {url}: give https://NAME, with the port if it has one of its own, and nothing behind"
        raise InputError(text) from error


def announce(links: Mapping[str, str]) -> None:
    """The raters' links on standard output."""
    for rater, link in links.items():
        print(f"{rater}  {link}")
    print("(stop with Ctrl-C; the same command goes on later)", flush=True)


@study_app.command("report")
def study_report(run: Run) -> int:
    """Write Table 2 of the votes so far, the raters, and the votes as a table."""
    find_run(run)
    from dcap.evaluation.statistics.comparisons import JudgedAxis
    from dcap.evaluation.study.tables import agreement_line, overall_line
    from flows.study.serve import report_study

    found = report_study(run)
    for row in found.table.rows:
        won, mark = row.rates.get(JudgedAxis.OVERALL), row.mark(JudgedAxis.OVERALL)
        if won is None or row.rating is None:
            continue
        share = f"{100 * won.rate:5.1f} % [{100 * won.interval.low:.1f}, {100 * won.interval.high:.1f}] {mark}".rstrip()
        print(f"{found.table.name(row.method):32s} {share}  {row.rating.rating:.0f}  {won.comparisons} comparisons")
    print(overall_line(found.table))
    print(agreement_line(found.table))
    if found.table.refusals:
        print(f"No placement where one was intended: {found.table.refusals}.")
    if found.changed:
        note(f"{len(found.changed)} placements have changed since they were voted on: {', '.join(found.changed[:3])}")
    for one in found.raters:
        if one.flagged:
            note(f"{one.rater} failed {one.checks_failed} of {one.checks} attention checks; the votes are included")
    print(f"{found.csv}\n{found.tex}")
    return 0
