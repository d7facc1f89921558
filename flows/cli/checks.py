"""Shared by the commands: their parameters, from the models of flows/options.py, and notes to a person."""

import inspect
import json
from collections.abc import Callable, Iterator
from functools import wraps
from types import NoneType
from typing import Annotated, Any, Literal, get_args, get_origin

import typer
from pydantic.fields import FieldInfo

from flows.options import Options, setting_of
from flows.settings import effective_options

COMMANDLINE = "COMMANDLINE"
"""Click's name for the source of typed values."""
OPTIONS = "options"
"""Name of the command's parameter that the options of its model replace."""
Run = Annotated[str, typer.Argument(help="Name or folder of a run, or 'last'.")]
PlacedRun = Annotated[
    str, typer.Argument(metavar="RUN", help="Name or folder of a run, 'last', or a folder that `place` wrote.")
]
Sample = Annotated[str | None, typer.Argument(help="Id of a sample of the run.")]
Json = Annotated[bool, typer.Option("--json", help="Print the result as JSON on standard output.")]
Verbose = Annotated[bool, typer.Option("--verbose", help="Print the notes of placement.json, too.")]
Command = Callable[..., int]


def with_options(kind: type[Options], *names: str) -> Callable[[Command], Command]:
    """Replace a command's parameter `options` by the options of a model, all of them or those named.

    The command is called with the model built from these options, `dcap.yaml` and the environment. An option that the
    command declares itself, because its help or default differs, is part of the model too.
    """
    wanted = names or tuple(name for name in own_fields_first(kind) if setting_of(kind.model_fields[name]).is_flag)

    def decorate(command: Command) -> Command:
        own = inspect.signature(command).parameters

        def parameters() -> Iterator[inspect.Parameter]:
            yield inspect.Parameter("context", inspect.Parameter.KEYWORD_ONLY, annotation=typer.Context)
            for name, parameter in own.items():
                if name == OPTIONS:
                    yield from (option_parameter(one, kind.model_fields[one]) for one in wanted if one not in own)
                elif name != "context":
                    yield parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY)

        @wraps(command)
        def run(context: typer.Context, **values: object) -> int:
            flags = {name: value for name, value in typed_flags(context).items() if name in wanted}
            mine = {name: value for name, value in values.items() if name in own}
            if "context" in own:
                mine["context"] = context
            return command(**mine, options=effective_options(kind, flags))

        run.__signature__ = inspect.Signature(list(parameters()))  # type: ignore[attr-defined]
        return run

    return decorate


def own_fields_first(kind: type[Options]) -> list[str]:
    """Return the fields of a model, its own before those that it inherits."""
    declared = (name for base in kind.__mro__ for name in vars(base).get("__annotations__", ()))
    return [name for name in dict.fromkeys(declared) if name in kind.model_fields]


def option_parameter(name: str, field: FieldInfo) -> inspect.Parameter:
    """Return a field as a parameter of the command line."""
    bounds = {key: getattr(one, bound) for key, bound in (("min", "ge"), ("max", "le")) for one in field.metadata
              if hasattr(one, bound)}  # fmt: skip
    option = typer.Option(
        "--" + name.replace("_", "-"), help=field.description, metavar=setting_of(field).metavar,
        show_default=field.default not in ("", None), **bounds,
    )  # fmt: skip
    kind = plain_type(field.annotation)
    annotation: Any = Annotated[kind if field.default is not None else kind | None, option]
    default = inspect.Parameter.empty if field.is_required() else field.default
    return inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=default, annotation=annotation)


def plain_type(annotation: Any) -> Any:
    """Return the type that the command line parses for an annotation: text for a Literal, T for `T | None`."""
    if get_origin(annotation) is Annotated:
        return plain_type(get_args(annotation)[0])
    if get_origin(annotation) is Literal:
        return str
    inner = [one for one in get_args(annotation) if one is not NoneType]
    return plain_type(inner[0]) if inner else annotation


def typed_flags(context: typer.Context) -> dict[str, object]:
    """Return the parameters that were typed on the command line, by name."""
    return {
        name: value
        for name, value in context.params.items()
        if getattr(context.get_parameter_source(name), "name", "") == COMMANDLINE
    }


def print_result(value: object, words: str, *, as_json: bool) -> None:
    """Print a result on standard output: as JSON, or in words if there are any."""
    from dcap.scene.written_files import to_json

    text = json.dumps(to_json(value), indent=2, ensure_ascii=False) if as_json else words
    if text:
        typer.echo(text)


def note(text: str) -> None:
    """Print a note for the user on standard error."""
    typer.echo(f"dcap: {text}", err=True)
