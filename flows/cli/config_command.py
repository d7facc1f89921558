"""`dcap config show`."""

import json
from typing import Annotated

import typer

from flows.cli.checks import Json, given
from flows.options import PlaceOptions

config_app = typer.Typer(help="Settings and where they come from.", no_args_is_help=True, rich_markup_mode=None)


@config_app.callback()
def config() -> None:
    """Settings and where they come from."""  # with a callback `show` stays a word of its own


@config_app.command("show")
def config_show(
    context: typer.Context,
    every: Annotated[bool, typer.Option("--all", help="The stages' settings that have their defaults, too.")] = False,
    workers: Annotated[int | None, typer.Option(help="This and the others: as if given to a command.")] = None,
    methods: Annotated[str | None, typer.Option()] = None,
    language: Annotated[str | None, typer.Option()] = None,
    model: Annotated[str | None, typer.Option()] = None,
    record: Annotated[str | None, typer.Option()] = None,
    replay: Annotated[str | None, typer.Option()] = None,
    max_cost: Annotated[float | None, typer.Option()] = None,
    batch: Annotated[bool, typer.Option("--batch")] = False,
    solver: Annotated[str | None, typer.Option()] = None,
    resolution: Annotated[float | None, typer.Option()] = None,
    threads: Annotated[int | None, typer.Option()] = None,
    arch: Annotated[str | None, typer.Option()] = None,
    stability: Annotated[bool, typer.Option("--stability")] = False,
    load_aware: Annotated[bool, typer.Option("--load-aware")] = False,
    paper_limits: Annotated[bool, typer.Option("--paper-limits")] = False,
    ambiguous: Annotated[str | None, typer.Option()] = None,
    port: Annotated[int | None, typer.Option()] = None,
    as_json: Json = False,
) -> int:
    """Show the settings in force and where each came from: default, file, environment or flag."""
    from dcap.scene.json_tree import to_json
    from flows.settings.given import Origin, settings_file
    from flows.settings.own import OWN, effective_options
    from flows.settings.table import secrets, settings_in_force

    flags = given(context)
    effective_options(PlaceOptions, {name: flags[name] for name in PlaceOptions.model_fields if name in flags})
    rows = settings_in_force(flags)
    if not every:
        rows = [one for one in rows if one.origin is not Origin.DEFAULT or one.key.partition(".")[0] in OWN]
    file = settings_file()
    if as_json:
        tree = to_json({"file": str(file) if file else None, "settings": rows, "secrets": secrets()})
        print(json.dumps(tree, indent=2, ensure_ascii=False))
        return 0
    print(f"# {file or 'no dcap.yaml'}")
    for one in rows:
        print(f"{one.key} = {json.dumps(one.value, ensure_ascii=False)}  # {one.origin} {one.where}".rstrip())
    for name, state in secrets().items():
        print(f"# {name}: {state}")
    return 0
