"""The options of place and drop: one type, the same names everywhere, none of them lost."""

import inspect
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest
import typer

from dcap.scene.errors import InputError
from dcap.scene.types.sample import Sample
from dcap.scene.types.units import METRES
from flows.cli import app as cli
from flows.cli.checks import given
from flows.configure import changed, configured
from flows.drop_one import drop_case
from flows.one_sample import sample_of
from flows.options import UNITS, DropKeywords, DropOptions, PlaceKeywords, PlaceOptions, checked
from tasks.mesh.stage import MeshConfig

OTHER: dict[str, Any] = {
    "out": Path("elsewhere"), "solver": "mls", "resolution": 0.013, "threads": 3, "arch": "cuda", "stability": True,
    "load_aware": True, "language": "anthropic", "model": "m", "record": "r", "replay": "p", "max_cost": 1.5,
    "label": "sofa", "up": "y", "unit": "cm", "object_label": "mug", "object_up": "-z", "object_unit": "in",
    "mass": 2.5, "seed": 7, "paper_limits": True, "height_of": "table=0.75", "labels": "labels.json", "at": "1,2.5,-3",
    "support": "0,0,0,1,1,1", "ambiguous": "best", "maps": True, "animate": True, "surface": "iso",
}  # fmt: skip
"""A value of every option that is not its default."""
ASKED = {"language", "model", "record", "replay", "max_cost"}
"""They reach the stages through LanguageOptions; tests/flows/test_model_runs.py follows them."""


@pytest.mark.parametrize(
    ("kind", "keywords", "command", "arguments"),
    [
        (PlaceOptions, PlaceKeywords, cli.place, {"scene", "object", "prompt"}),
        (DropOptions, DropKeywords, cli.drop, {"case"}),
    ],
)
def test_the_same_options_everywhere(
    kind: type[DropOptions], keywords: Any, command: Any, arguments: set[str]
) -> None:  # fmt: skip
    """Python and the command line take the same options by the same names, with the same defaults."""
    parameters = inspect.signature(command).parameters
    taken = set(parameters) - arguments - {"context", "as_json"}
    assert taken == set(kind.model_fields) == set(keywords.__annotations__)
    for name in taken - {"out"}:
        assert parameters[name].default == kind.model_fields[name].default, name


def test_every_option_reaches_the_stages() -> None:
    """Each option of a placement changes what is placed or how a stage is configured."""
    plain = PlaceOptions()
    assert set(OTHER) == set(PlaceOptions.model_fields)
    before = decided(plain)
    for name in set(OTHER) - ASKED - {"out", "maps", "animate", "surface"}:  # where and what is written
        assert decided(checked(PlaceOptions, {name: OTHER[name]})) != before, name


def decided(options: PlaceOptions) -> tuple[Sample, dict[str, object]]:
    """What a placement is made of."""
    return sample_of("scene", "object", "put it", options), configured(options, arch=options.arch).model_dump()


def test_every_option_reaches_the_drop(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """The physics gets what was asked for."""
    heard: dict[str, object] = {}
    monkeypatch.setattr("flows.drop_one.run_case", lambda case, out, **given: heard.update(given) or {})
    monkeypatch.setattr("flows.drop_one.chosen_arch", lambda wanted: wanted)
    wanted = {name: OTHER[name] for name in DropOptions.model_fields if name != "out"} | {"solver": "tl"}
    drop_case(tmp_path, checked(DropOptions, wanted), tmp_path, quiet=True)
    assert heard == wanted | {"quiet": True, "settings": {}}


@pytest.mark.parametrize("name", sorted(PlaceOptions.model_fields))
def test_the_command_line_hands_everything_over(name: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """Each option of `dcap place` arrives in the options of the placement."""
    heard: list[PlaceOptions] = []

    def place_files(scene: str, thing: str, prompt: str, options: PlaceOptions, out: Path, *, quiet: bool) -> Any:
        heard.append(options)
        raise InputError("far enough")

    monkeypatch.setattr("flows.place_one.place_files", place_files)
    value = tmp_path if name == "out" else OTHER[name]
    words = ["--" + name.replace("_", "-")] + ([] if value is True else [str(value)])
    assert cli.main(["place", "a", "b", "put it", *words]) == 2
    assert heard == [checked(PlaceOptions, {name: value})]


def test_every_unit_is_an_option() -> None:
    """What a file may be counted in can be said."""
    assert set(UNITS) == {"auto", *METRES}


def test_an_unknown_option_names_the_nearest() -> None:
    """A misspelt option is refused with the word that was meant; one of place is none of drop."""
    with pytest.raises(InputError, match="'treads'; did you mean 'threads'"):
        checked(DropOptions, {"treads": 2})
    with pytest.raises(InputError, match="unknown option 'paper_limits'"):
        checked(DropOptions, {"paper_limits": True})


def test_an_unknown_setting_of_a_stage() -> None:
    """A setting that a stage does not have is an error, never dropped."""
    with pytest.raises(ValueError, match="thraeds"):
        changed(MeshConfig(), {"thraeds": 2})


def test_a_parameter_that_is_no_option() -> None:
    """A parameter of a command that is neither an argument nor an option is refused, not lost."""
    source = SimpleNamespace(name="COMMANDLINE")
    told = SimpleNamespace(params={"case": "a", "bogus": 1}, get_parameter_source=lambda _: source)
    context = cast(typer.Context, told)
    with pytest.raises(InputError, match="unknown option 'bogus'"):
        checked(DropOptions, given(context, "case"))
