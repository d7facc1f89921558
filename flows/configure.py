"""Turns options into the stages' configurations."""

from collections.abc import Mapping
from typing import TypeVar

from pydantic import BaseModel

from dcap.language.protocol.client import LanguageConfig
from flows.options import StageOptions
from flows.place import PlaceConfig
from flows.settings.stages import stage_settings

Config = TypeVar("Config", bound=BaseModel)


def configured(options: StageOptions, *, language: LanguageConfig | None = None, arch: str = "cpu") -> PlaceConfig:
    """Return the stages' settings (flows/settings) with a person's choices in them.

    `arch` is cpu or cuda, to which `options.arch` resolves on this machine: keys of the cache must not depend on the
    hardware in another way. `language` follows from several options (flows/language_options.py).
    """
    default = stage_settings()
    asking = {"language": language or LanguageConfig()}
    threads = {"threads": options.threads}
    physics = changed(
        default.drop.solver,
        {
            "arch": arch,
            "method": options.solver,
            "stability": options.stability,
        },
    )
    stages = {
        "scene_mesh": changed(default.scene_mesh, threads),
        "object_mesh": changed(default.object_mesh, threads),
        "segment": changed(default.segment, asking),
        "intent": changed(default.intent, {**asking, "ambiguous": options.ambiguous}),
        "rotation": changed(default.rotation, asking),
        "anchor": changed(default.anchor, asking),
        "materials": changed(
            default.materials, {**asking, "load_aware": options.load_aware, "paper_limits": options.paper_limits}
        ),
        "particles": changed(default.particles, {"cell": options.resolution}),
        "drop": changed(default.drop, {"solver": physics, **threads}),
        "drift": changed(default.drift, threads),
    }
    return changed(default, stages)


def with_threads(config: PlaceConfig, threads: int) -> PlaceConfig:
    """Return the settings with so many threads for every stage that has some: they change no result."""
    stages = {name: getattr(config, name) for name in PlaceConfig.model_fields}
    return changed(
        config, {name: changed(one, {"threads": threads}) for name, one in stages.items() if hasattr(one, "threads")}
    )


def changed(config: Config, settings: Mapping[str, object]) -> Config:
    """Return the configuration with some settings replaced and checked; a name that it does not have is an error."""
    return type(config).model_validate({**dict(config), **settings})
