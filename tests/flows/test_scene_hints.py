"""What a person says besides the sentence is checked before anything runs."""

from pathlib import Path

import pytest

from dcap.scene.errors import InputError
from dcap.scene.types.sample import GivenPlace, KnownHeight
from flows.cli.app import main
from flows.options import PlaceOptions
from flows.scene_hints import given_labels, height_of, place_of
from flows.settings import effective_options


def test_points_boxes_and_heights_are_numbers() -> None:
    """Two or three for a point, six for a box; Python may give them as sequences."""
    assert place_of("1, 2.5", "") == GivenPlace(at=(1.0, 2.5))
    assert place_of("1,2.5,-3e-1", "") == GivenPlace(at=(1.0, 2.5, -0.3))
    assert place_of("", "0,0,0,1,1,1") == GivenPlace(support=(0, 0, 0, 1, 1, 1))
    assert place_of("", "") is None
    assert height_of("Dining Table=0.75", "auto") == KnownHeight("dining table", 0.75)
    assert effective_options(PlaceOptions, {"at": [1, 2.5, -3]}).at == "1,2.5,-3"
    assert effective_options(PlaceOptions, {"support": (0, 0, 0, 1, 1, 1)}).support == "0,0,0,1,1,1"


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--at", "1"], "--at '1' is not 2 or 3 finite numbers"),
        (["--at", "1,x,3"], "--at '1,x,3'"),
        (["--at", "nan,0,0"], "--at 'nan,0,0' is not 2 or 3 finite numbers"),
        (["--at", "1e999,0"], "--at '1e999,0'"),
        (["--support", "0,0,0,1,1"], "--support '0,0,0,1,1' is not 6 finite numbers"),
        (["--support", "0,0,2,1,1,1"], "z0 2 is not below z1 1; give the lowest corner"),
        (["--at", "0,0", "--support", "0,0,0,1,1,1"], "give one of them"),
        (["--height-of", "table"], "--height-of 'table' is not THING=METRES"),
        (["--height-of", "table=nan"], "--height-of 'table=nan'"),
        (["--height-of", "=0.7"], "--height-of '=0.7'"),
        (["--height-of", "table=75"], "height from 0.02 to 3 m"),
        (["--height-of", "table=0.7", "--unit", "cm"], "--unit cm: give one of them"),
    ],
)
def test_what_cannot_be_meant_is_one_line(
    capsys: pytest.CaptureFixture[str], arguments: list[str], words: str
) -> None:  # fmt: skip
    """Exit code 2 with the option, its value and what it should be."""
    assert main(["place", "a", "b", "put it there", *arguments]) == 2
    said = capsys.readouterr().err
    assert words in said
    assert said.count("\n") == 1


def test_labels_that_are_not_there(tmp_path: Path) -> None:
    """The option and the path."""
    with pytest.raises(InputError, match=r"--labels .*gone\.json: no such file"):
        given_labels(str(tmp_path / "gone.json"))
