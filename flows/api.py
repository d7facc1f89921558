"""Python interface behind `import dcap`, for notebooks and other programs. Nothing is printed; every error is raised.

Options are those of the command line, with underscores in their names (`DropOptions`, `PlaceOptions`); omitted
options are read from `dcap.yaml` or the environment, as there.
"""

import os
import secrets
from collections.abc import Callable, Mapping
from datetime import datetime
from inspect import cleandoc
from pathlib import Path
from typing import TypeVar

from dcap.quiet_imports import quiet_imports
from dcap.scene.settings import runs_root
from flows.options import DropOptions, Options, PlaceOptions, check_case, check_out, check_prompt
from flows.results import Placement, Result
from flows.settings import effective_options, exported_paths
from tasks.machine_errors import as_machine_errors

AnyPath = str | os.PathLike[str]
Function = TypeVar("Function", bound=Callable[..., object])


def with_help(kind: type[Options]) -> Callable[[Function], Function]:
    """Decorate a function so that `help` lists every option of a model with its meaning."""

    def decorate(function: Function) -> Function:
        rows = [f"- `{name}`: {field.description}" for name, field in kind.model_fields.items()]
        function.__doc__ = "\n".join([cleandoc(function.__doc__ or ""), "", "Options:", "", *rows])
        return function

    return decorate


@with_help(PlaceOptions)
@exported_paths()
def place(scene: AnyPath, object: AnyPath, prompt: str, **options: object) -> Placement:  # noqa: A002
    """Place one object in one scene, as `dcap place` does.

    `scene` is a folder (InteriorGS, ScanNet, SuGaR) or a mesh, `object` a mesh, `prompt` says what to do. An infeasible
    placement is a result with a reason. The files go into `out`, by default a new folder below `data/runs/python`.

    Raises InputError for input or options that cannot be used, LanguageError for a prompt that was not understood,
    MachineError for a full disk and the like, and other kinds of DcapError.
    """
    chosen = effective_options(PlaceOptions, options)
    check_prompt(prompt)
    out = chosen.out or new_folder("place")
    check_out(out)
    with quiet_imports():  # after the checks: the stages bring heavy libraries
        from flows.place_one import place_files

    with as_machine_errors():
        return Placement.of(place_files(os.fspath(scene), os.fspath(object), prompt, chosen, out, quiet=True), out)


@with_help(DropOptions)
@exported_paths()
def drop(case: AnyPath | Mapping[str, object], **options: object) -> Result:
    """Settle the bodies of a case file, or of a dict of the same structure, as `dcap drop` does; physics only.

    Meshes that a dict names are relative to the working directory. The files go into `out`, by default a new folder
    below `data/runs/python`.

    Raises InputError for a case or options that cannot be used, MachineError for a full disk and the like.
    """
    chosen = effective_options(DropOptions, options)
    if not isinstance(case, Mapping):
        case = Path(case)
        check_case(case)
    out = chosen.out or new_folder("drop")
    check_out(out)
    with quiet_imports():
        from flows.place_one import drop_case

    with as_machine_errors():
        return Result.of(drop_case(case, chosen, out, quiet=True), out)


def new_folder(kind: str) -> Path:
    """Unused folder name below the runs; the folder is created once there is a result."""
    return runs_root() / "python" / f"{kind}-{datetime.now():%Y%m%d-%H%M%S}-{secrets.token_hex(3)}"
