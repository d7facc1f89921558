"""Turns the options of the command line into the stages' configurations."""

from pydantic import BaseModel, ValidationError

from dcap.language.protocol.client import LanguageConfig
from dcap.scene.errors import InputError
from flows.place import PlaceConfig

ASKING = ("segment", "intent", "rotation", "anchor", "materials")
"""Stages that ask questions."""


def configured(
    *,
    language: LanguageConfig | None = None,
    resolution: float | None = None,
    threads: int = 0,
    solver: str = "tl",
    arch: str = "cpu",
    stability: bool = False,
    load_aware: bool = False,
    paper_limits: bool = False,
) -> PlaceConfig:
    """The default configuration with the user's choices in it; `arch` is cpu or cuda: a key of the cache must not
    depend on what this machine has."""
    config = PlaceConfig()
    for stage in ASKING:
        part = getattr(config, stage).model_copy(update={"language": language or LanguageConfig()})
        config = config.model_copy(update={stage: part})
    config = with_setting(config, "materials", {"load_aware": load_aware}, "--load-aware")
    config = with_setting(config, "materials", {"paper_limits": paper_limits}, "--paper-limits")
    if resolution is not None:
        config = with_setting(config, "particles", {"cell": resolution}, f"--resolution {resolution}")
    physics = config.drop.solver.model_dump() | {"arch": arch, "method": solver, "stability": stability}
    if solver == "mls":
        physics["mls_cell"] = resolution
    config = with_setting(config, "drop", {"solver": physics}, f"--solver {solver} --arch {arch}")
    for stage in ("scene_mesh", "object_mesh", "drop"):
        config = with_setting(config, stage, {"threads": threads}, f"--threads {threads}")
    return config


def with_setting(config: PlaceConfig, stage: str, change: dict[str, object], option: str) -> PlaceConfig:
    """The configuration with one stage's settings changed and checked."""
    part: BaseModel = getattr(config, stage)
    known = {name: value for name, value in change.items() if name in type(part).model_fields}
    if not known:
        return config
    try:
        return config.model_copy(update={stage: type(part).model_validate(part.model_dump() | known)})
    except ValidationError as error:
        raise InputError(f"{option}: {error.errors()[0]['msg']}") from error
