"""One drop for a person: options to the physics."""

from collections.abc import Mapping
from pathlib import Path

from dcap.scene.json_tree import JsonObject
from flows.options import DropOptions
from tasks.arch import chosen_arch
from tasks.case.run import run_case


def drop_case(case: Path | Mapping[str, object], options: DropOptions, out: Path, *, quiet: bool) -> JsonObject:
    """Settle the bodies of a case; writes the results into `out`, returns result.json."""
    return run_case(
        case,
        out,
        solver=options.solver,
        arch=chosen_arch(options.arch),
        resolution=options.resolution,
        threads=options.threads,
        stability=options.stability,
        load_aware=options.load_aware,
        quiet=quiet,
    )
