"""`dcap config show`."""

import json
from typing import Annotated

import typer

from flows.cli.checks import Json, given, with_options
from flows.options import KEYS, AllSettings, setting_of

config_app = typer.Typer(help="Settings and where they come from.", no_args_is_help=True, rich_markup_mode=None)
FLAGS = tuple(name for name in KEYS.values() if setting_of(AllSettings.model_fields[name]).is_flag)


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
    from dcap.scene.json_tree import to_json
    from flows.given_settings import Origin, section_of, settings_file
    from flows.settings.effective import OWN
    from flows.settings.table import secrets, settings_in_force

    rows = settings_in_force(options, given(context))
    if not every:
        rows = [one for one in rows if one.origin is not Origin.DEFAULT or section_of(one.key) in OWN]
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
