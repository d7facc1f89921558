"""One drop for a person: options to the physics."""

from collections.abc import Mapping
from pathlib import Path

from dcap.scene.json_tree import JsonObject
from flows.given_settings import given_settings
from flows.options import DropOptions
from flows.settings.effective import OWN
from tasks.arch import chosen_arch
from tasks.case.run import run_case

SOLVER = "drop.solver."
"""Section whose settings are those of a case's solver, too."""


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
        settings=solver_settings(),
        quiet=quiet,
    )


def solver_settings() -> Mapping[str, object]:
    """The solver's settings from `dcap.yaml` and the environment, checked together with those of the stages."""
    given = [key for key in given_settings() if key.partition(".")[0] not in OWN]
    if not given:
        return {}
    from flows.settings.stages import stage_settings  # only then: the stages bring heavy libraries

    solver = stage_settings().drop.solver.model_dump()
    return {key.removeprefix(SOLVER): solver[key.removeprefix(SOLVER)] for key in given if key.startswith(SOLVER)}
