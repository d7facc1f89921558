"""The options of the commands: declared once, the same everywhere, none of them lost."""

from pathlib import Path
from typing import Any, get_args

import pytest

from dcap.scene.errors import InputError
from dcap.scene.types.sample import Sample
from dcap.scene.types.scan import METRES
from flows.benchmark_config import benchmark_config
from flows.cli import app as cli
from flows.configure import changed, configured
from flows.options import KEYS, AllSettings, BenchmarkOptions, DropOptions, PlaceOptions, Unit
from flows.place import PlaceConfig
from flows.place_one import drop_case, sample_of
from flows.settings import effective_options, value_at
from tasks.mesh.stage import MeshConfig

OTHER: dict[str, Any] = {
    "out": Path("elsewhere"), "solver": "mls", "resolution": 0.013, "threads": 3, "arch": "cuda", "stability": True,
    "load_aware": True, "language": "anthropic", "model": "m", "effort": "low",
    "max_tokens": 2048, "reply_timeout": 90.0, "record": "r", "replay": "p", "max_cost": 1.5,
    "label": "sofa", "up": "y", "unit": "cm", "object_label": "mug", "object_up": "-z", "object_unit": "in",
    "mass": 2.5, "seed": 7, "paper_limits": True, "height_of": "table=0.75", "labels": "labels.json", "at": "1,2.5,-3",
    "support": "0,0,0,1,1,1", "ambiguous": "best", "method": "paper", "maps": True, "animate": True, "surface": "iso",
}  # fmt: skip
"""A value of every option that is not its default."""
ASKED = {"language", "model", "effort", "max_tokens", "reply_timeout", "record", "replay", "max_cost"}
"""They reach the stages through LanguageOptions; tests/flows/test_model_runs.py follows them."""


def test_every_option_reaches_the_stages() -> None:
    """Each option of a placement changes what is placed or how a stage is configured."""
    plain = PlaceOptions()
    assert set(OTHER) == set(PlaceOptions.model_fields)
    before = decided(plain)
    for name in set(OTHER) - ASKED - {"out", "maps", "animate", "surface"}:  # where and what is written
        assert decided(effective_options(PlaceOptions, {name: OTHER[name]})) != before, name


def decided(options: PlaceOptions) -> tuple[Sample, dict[str, object]]:
    """What a placement is made of."""
    return sample_of("scene", "object", "put it", options), configured(options, arch=options.arch).model_dump()


def test_every_option_reaches_the_drop(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """The physics gets what was asked for."""
    heard: dict[str, object] = {}
    monkeypatch.setattr("tasks.case.run.run_case", lambda case, out, **given: heard.update(given) or {})
    monkeypatch.setattr("flows.place_one.chosen_arch", lambda wanted: wanted)
    wanted = {name: OTHER[name] for name in DropOptions.model_fields if name != "out"} | {"solver": "tl"}
    drop_case(tmp_path, effective_options(DropOptions, wanted), tmp_path, quiet=True)
    assert heard == wanted | {"quiet": True, "settings": {}}


def test_the_command_line_hands_everything_over(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path, subtests: pytest.Subtests
) -> None:
    """Each option of `dcap place` arrives in the options of the placement."""
    heard: list[PlaceOptions] = []

    def place_files(scene: str, thing: str, prompt: str, options: PlaceOptions, out: Path, *, quiet: bool) -> Any:
        heard.append(options)
        raise InputError("far enough")

    monkeypatch.setattr("flows.place_one.place_files", place_files)
    for name in sorted(PlaceOptions.model_fields):
        heard.clear()
        with subtests.test(name):
            value = tmp_path if name == "out" else OTHER[name]
            words = ["--" + name.replace("_", "-")] + ([] if value is True else [str(value)])
            assert cli.main(["place", "a", "b", "put it", *words]) == 2
            assert heard == [effective_options(PlaceOptions, {name: value})]


def test_every_unit_is_an_option() -> None:
    """What a file may be counted in can be said."""
    assert set(get_args(Unit)) == {"auto", *METRES}


def test_an_unknown_option_names_the_nearest() -> None:
    """A misspelt option is refused with the word that was meant; one of place is none of drop."""
    with pytest.raises(InputError, match="'treads'; did you mean 'threads'"):
        effective_options(DropOptions, {"treads": 2})
    with pytest.raises(InputError, match="unknown option 'paper_limits'"):
        effective_options(DropOptions, {"paper_limits": True})


def test_an_unknown_setting_of_a_stage() -> None:
    """A setting that a stage does not have is an error, never dropped."""
    with pytest.raises(ValueError, match="thraeds"):
        changed(MeshConfig(), {"thraeds": 2})


def test_defaults_are_those_of_the_stages() -> None:
    """An option that sets a stage's field has its default, so that nothing given is the same as the default given."""
    stages = PlaceConfig().model_dump(mode="json")
    for key, name in KEYS.items():
        if key.partition(".")[0] in stages and name != "ambiguous":  # a benchmark cannot ask
            assert AllSettings.model_fields[name].default == value_at(stages, key), key
    assert PlaceOptions().ambiguous == value_at(stages, "intent.ambiguous")


def test_who_places_divides_the_cores(monkeypatch: pytest.MonkeyPatch) -> None:
    """Threads of this program share its cores; a worker of the pool has its own, unless a person gave a number."""
    monkeypatch.setattr("flows.benchmark_config.available_cores", lambda: 8)

    def threads(**asked: object) -> int:
        return benchmark_config(effective_options(BenchmarkOptions, {"workers": 4, **asked}))[0].drop.threads

    assert threads() == 2
    assert threads(runner="dask") == 2
    assert threads(runner="pool") == 0
    assert threads(runner="pool", threads=3) == 3
