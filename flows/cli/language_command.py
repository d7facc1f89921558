"""`dcap language check`."""

import typer

from flows.cli.checks import with_options
from flows.options import PlaceOptions

language_app = typer.Typer(help="Try a model.", no_args_is_help=True, rich_markup_mode=None)


@language_app.callback()
def language() -> None:
    """Try a model."""  # with a callback `check` stays a word of its own


@language_app.command("check")
@with_options(PlaceOptions, "language", "model", "effort", "max_tokens", "reply_timeout", "max_cost")
def language_check(options: PlaceOptions) -> int:
    """Ask a model a dozen questions with known answers about an embedded room: what to run first with a new key."""
    from dcap.scene.settings import runs_root
    from flows.language_check import check_language, row_in_words, totals_in_words
    from flows.language_options import language_options

    folder = runs_root() / "language-check"
    rows = check_language(language_options(options), folder, lambda row: print(row_in_words(row), flush=True))
    print(totals_in_words(rows))
    return 0
