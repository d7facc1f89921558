"""What `import dcap` offers to notebooks and other programs; nothing is printed, every error is raised.

Options are those of the command line, with underscores in their names (`DropOptions`, `PlaceOptions`); what is not
given may stand in `dcap.yaml` or the environment, as there.
"""

import os
import secrets
from collections.abc import Mapping
from datetime import datetime
from pathlib import Path
from typing import Unpack

from dcap.quiet_imports import quiet_imports
from dcap.scene.machine_errors import as_machine_errors
from dcap.scene.settings import runs_root
from flows.options import (
    DropKeywords,
    DropOptions,
    PlaceKeywords,
    PlaceOptions,
    check_case,
    check_out,
    check_prompt,
)
from flows.results import Placement, Result
from flows.settings.own import effective_options, exported_paths

AnyPath = str | os.PathLike[str]


@exported_paths()
def place(scene: AnyPath, object: AnyPath, prompt: str, **options: Unpack[PlaceKeywords]) -> Placement:  # noqa: A002
    """Place one object in one scene, as `dcap place` does.

    `scene` is a folder (InteriorGS, ScanNet, SuGaR) or a mesh, `object` a mesh, `prompt` says what to do. An infeasible
    placement is a result with a reason. The files go into `out`, by default a new folder below `data/runs/python`.

    What the files do not say: `label`, `up` and `unit` of the scene, `height_of` (THING=METRES) for its scale,
    `labels` (a file that names its things), `at` or `support` (a point or a box of its own frame) for the place;
    `object_label`, `object_up`, `object_unit`, `mass` [kg]. Who reads the prompt: `language`, `model`, `record`,
    `replay`, `max_cost` [USD]; `ambiguous`: ask (an error that lists what may be meant) or best. The physics:
    `solver`, `resolution` [m], `threads`, `arch`, `seed`, `stability`, `load_aware`, `paper_limits`. Each is
    explained by `dcap place --help`. `out` is the folder of the results; `maps` adds
    conditioning maps to it, `animate` a film of the drop,
    `surface` "iso" the surfaces around the material points.

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


@exported_paths()
def drop(case: AnyPath | Mapping[str, object], **options: Unpack[DropKeywords]) -> Result:
    """Settle the bodies of a case file, or of a dict of the same structure, as `dcap drop` does; physics only.

    Meshes that a dict names are relative to the working directory. The files go into `out`, by default a new folder
    below `data/runs/python`. Options: `solver`, `resolution` [m], `threads`, `arch`, `stability`, `load_aware`.

    Raises InputError for a case or options that cannot be used, MachineError for a full disk and the like.
    """
    chosen = effective_options(DropOptions, options)
    if not isinstance(case, Mapping):
        case = Path(case)
        check_case(case)
    out = chosen.out or new_folder("drop")
    check_out(out)
    with quiet_imports():
        from flows.drop_one import drop_case

    with as_machine_errors():
        return Result.of(drop_case(case, chosen, out, quiet=True), out)


def new_folder(kind: str) -> Path:
    """A folder below the runs that nobody has yet, and that is not made before there is a result."""
    return runs_root() / "python" / f"{kind}-{datetime.now():%Y%m%d-%H%M%S}-{secrets.token_hex(3)}"
