"""`dcap study serve|report`."""

from collections.abc import Mapping
from typing import Annotated

import typer

from dcap.scene.errors import InputError
from flows.cli.checks import Run, note
from flows.find_run import find_run
from flows.own_requests import LOOPBACK, origin_of

study_app = typer.Typer(no_args_is_help=True, help="A study in which people compare the methods of a run.")


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
    from flows.study.report import report_study

    found = report_study(run)
    for row in found.table.rows:
        won, mark = row.rates.get(JudgedAxis.OVERALL), row.marks.get(JudgedAxis.OVERALL, "")
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
