"""What the commands share: options as they were given, and values from closed lists."""

from typing import Annotated

import typer

from dcap.scene.errors import InputError
from dcap.scene.spelling import not_one_of

COMMANDLINE = "COMMANDLINE"
"""Name of the source of what a person has typed."""
Json = Annotated[bool, typer.Option("--json", help="Print the result as JSON on standard output.")]
Model = Annotated[str, typer.Option(help="Model to ask.")]
Record = Annotated[str, typer.Option(metavar="DIR", help="Keep a copy of each reply in this folder.")]
Replay = Annotated[str, typer.Option(metavar="DIR", help="Answer from replies recorded in this folder.")]
MaxCost = Annotated[float | None, typer.Option(help="Spend at most this on a model [USD].")]


def given(context: typer.Context, *besides: str) -> dict[str, object]:
    """Every parameter of a command that a person gave but those named: what is not an option of the physics is refused
    there, not lost; what nobody gave may stand in `dcap.yaml`."""
    return {
        name: value
        for name, value in context.params.items()
        if name not in besides and getattr(context.get_parameter_source(name), "name", "") == COMMANDLINE
    }


def note(text: str) -> None:
    """What a person should know, on standard error."""
    typer.echo(f"dcap: {text}", err=True)


def choice(option: str, value: str, allowed: tuple[str, ...]) -> str:
    """A value from a closed list."""
    if value not in allowed:
        raise InputError(f"{option} {value!r} {not_one_of(value, allowed)}")
    return value
