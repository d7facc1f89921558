"""Parses and checks the user's hints about a scene: labels, a point, a box, a height."""

from dataclasses import dataclass
from math import isfinite
from pathlib import Path

from dcap.scene.errors import InputError
from dcap.scene.readers.labels.given import read_given_labels
from dcap.scene.types.sample import GivenPlace, KnownHeight
from dcap.scene.types.segmentation import GivenLabels, VertexLabels
from tasks.artifact import Ref, Store

LOWEST, HIGHEST = 0.02, 3.0
"""Range of plausible heights of surfaces that carry things [m]."""


@dataclass(frozen=True, slots=True)
class LabelRefs:
    """Labels in the store, of instances or of the file's vertices."""

    things: Ref[GivenLabels] | None = None
    vertices: Ref[VertexLabels] | None = None


def given_labels(path: str) -> LabelRefs:
    """Read a file of labels into the store; no labels for an empty path."""
    if not path:
        return LabelRefs()
    if not Path(path).exists():
        raise InputError(f"--labels {path}: no such file")
    found = read_given_labels(Path(path))
    if isinstance(found, GivenLabels):
        return LabelRefs(things=Store.default().save(found))
    return LabelRefs(vertices=Store.default().save(found))


def numbers_of(option: str, text: str, counts: tuple[int, ...], example: str) -> tuple[float, ...]:
    """Parse comma-separated finite numbers; InputError with the option and its value."""
    words = [word.strip() for word in text.split(",")]
    try:
        numbers = tuple(float(word) for word in words)
    except ValueError:
        numbers = ()
    if len(numbers) not in counts or not all(isfinite(one) for one in numbers):
        wanted = " or ".join(str(count) for count in counts)
        raise InputError(f"{option} {text!r} is not {wanted} finite numbers between commas, for example {example}")
    return numbers


def place_of(at: str, support: str) -> GivenPlace | None:
    """The point or the box of --at and --support."""
    if at and support:
        raise InputError(f"--at {at} and --support {support}: give one of them")
    if at:
        return GivenPlace(at=numbers_of("--at", at, (2, 3), "1.2,0.4,0.75"))
    if not support:
        return None
    box = numbers_of("--support", support, (6,), "0,0,0.4,1.2,0.8,0.5")
    for axis, low, high in zip("xyz", box[:3], box[3:], strict=True):
        if low >= high:
            raise InputError(
                f"--support {support}: {axis}0 {low:g} is not below {axis}1 {high:g}; "
                "give the lowest corner and then the highest"
            )
    return GivenPlace(support=box)


def height_of(text: str, unit: str) -> KnownHeight | None:
    """The thing and the height of --height-of."""
    if not text:
        return None
    thing, _, value = text.partition("=")
    try:
        height = float(value)
    except ValueError:
        height = float("nan")
    if not thing.strip() or not LOWEST <= height <= HIGHEST:
        raise InputError(
            f"--height-of {text!r} is not THING=METRES with a height from {LOWEST} to {HIGHEST:g} m, "
            "for example table=0.75"
        )
    if unit != "auto":
        raise InputError(f"--height-of {text} and --unit {unit}: give one of them")
    return KnownHeight(" ".join(thing.lower().split()), height)
