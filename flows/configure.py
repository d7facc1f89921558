"""Turns the options of the command line into the stages' configurations."""

from pydantic import BaseModel, ValidationError

from flows.place import PlaceConfig
from scene.errors import InputError

LANGUAGES = ("offline", "anthropic")


def configured(
    *, language: str = "offline", resolution: float | None = None, threads: int = 0, solver: str = "tl"
) -> PlaceConfig:
    """The default configuration with the user's choices in it."""
    config = PlaceConfig()
    if language not in LANGUAGES:
        raise InputError(f"--language {language!r} is not one of {', '.join(LANGUAGES)}")
    for stage in ("intent", "rotation", "anchor", "materials"):
        config = with_setting(config, stage, {"client": language}, f"--language {language}")
    if resolution is not None:
        config = with_setting(config, "particles", {"cell": resolution}, f"--resolution {resolution}")
    if solver != "tl":
        method = config.drop.solver.model_dump() | {"method": solver, "mls_cell": resolution}
        config = with_setting(config, "drop", {"solver": method}, f"--solver {solver}")
    return with_setting(config, "drop", {"threads": threads}, f"--threads {threads}")


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
