"""`dcap judge`."""

from typing import Annotated

import typer

from dcap.scene.errors import InputError
from flows.cli.checks import note
from flows.find_run import find_run


def judge(
    run: Annotated[str | None, typer.Argument(help="Name or folder of a run of several methods, or 'last'.")] = None,
    validate: Annotated[
        bool,
        typer.Option("--validate", help="Ask about pairs with known answers instead, and say how many are right."),
    ] = False,
    language: Annotated[
        str,
        typer.Option(
            help="Who judges: offline (default: the metric rubric), anthropic, openai or replay.", show_default=False
        ),
    ] = "",
    model: Annotated[str, typer.Option(help="Model to ask; it must take pictures.", show_default=False)] = "",
    record: Annotated[
        str, typer.Option(metavar="DIR", help="Keep a copy of each reply in this folder.", show_default=False)
    ] = "",
    replay: Annotated[
        str, typer.Option(metavar="DIR", help="Judge by replies recorded in this folder.", show_default=False)
    ] = "",
    max_cost: Annotated[float | None, typer.Option(help="Spend at most this on judging the run [USD].")] = None,
    batch: Annotated[
        bool, typer.Option("--batch", help="Ask in batches: half the price, answers within a day.")
    ] = False,
) -> int:
    """Score and compare the methods of a run, and write Table 1; or tell how good a judge is."""
    if run is None and not validate:
        raise InputError("name the run to judge, or 'last'; without one there is --validate")
    if run is not None:
        find_run(run)
    from dcap.evaluation.method_report import shown_lines
    from flows.benchmark import rewrite_page
    from flows.judge_known import validate_judge
    from flows.judge_run import judge_run
    from flows.language_options import LanguageOptions

    asking = LanguageOptions(language, model, record, replay, max_cost, batch)
    if validate:
        found = validate_judge(run, asking, note)
        print(f"{found.accuracy.in_words}\n{found.path}")
        return 0
    assert run is not None
    judged = judge_run(run, asking, note)
    print("\n".join(shown_lines(judged.table)))
    print(f"{judged.csv}\nreport: {rewrite_page(judged.folder, judged.rows)}")
    return 0
