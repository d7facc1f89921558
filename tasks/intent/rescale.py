"""Decides the size of a mesh: unchanged, corrected by its unit, or the usual size of its kind.

In: the usual shapes of the mesh's kind (folded, spread out ...), their spread, and the mesh's extents. Out: one
isotropic factor, the shape that the mesh was compared with, and a sentence with the reason. Every comparison is the
median over the axes, sorted by length, of the usual extent over the mesh's extent, so that one odd axis (a handle, a
missing thickness) decides nothing.

A unit that the user gave is always used. Otherwise a mesh whose median lies within the spread of one shape is not
changed. Otherwise the unit is wrong, and the right one is a guess that needs evidence. A file without a unit may be in
centimetres, inches or millimetres though the reader assumed metres: a unit is accepted if it brings the mesh within the
spread; of several (centimetres and inches only differ by 2.54) the nearest is taken. Its exact factor preserves the
true size of the thing: a large mug stays a large mug. If the file states its unit, or if a guess would replace the
reader's guess of centimetres, a unit must bring the mesh close to the usual size. Otherwise the file's unit is unknown,
and the mesh is scaled to the usual size.
"""

from dataclasses import dataclass

import numpy as np

from dcap.arrays import Array
from dcap.scene.readers.frame import LIMITS, Role
from dcap.scene.types.outcome import Cause, Caution
from dcap.scene.types.scan import METRES, TAKEN_AS_METRES

TAKEN_AS_CENTIMETRES = {
    "inches taken as centimetres": METRES["in"] / METRES["cm"],
    "millimetres taken as centimetres": METRES["mm"] / METRES["cm"],
}
"""Factor by the file's true unit, if the reader found none and assumed centimetres [-]."""
OPTION = "--object-unit"
OVERRIDE = f"{OPTION} m, cm, mm or in keeps another size"
CONVINCING = 1.25
"""Factor of the usual size within which a unit must bring a mesh to override the file's unit or an earlier guess."""
SLACK = 1e-6
"""Tolerance of the spread, for rounding."""
THINNEST = 1e-3
"""Ratio of thickness to longest extent below which a mesh is a plane, whose thickness is ignored."""


@dataclass(frozen=True, slots=True)
class Rescale:
    """An isotropic factor and its reasons."""

    scale: float
    shape: Array
    """Usual extents with which the mesh was compared, largest first [m], shape (3,)."""
    note: str


def rescale(
    shapes: Array, extents: Array, spread: float, limits: tuple[float, float], unit_source: str = "estimate"
) -> Rescale:
    """The factor for a mesh of these extents [m].

    Args:
        shapes: usual extents of each shape that such things have [m], shape (shapes, 3).
        extents: of the mesh [m], shape (3,).
        spread: real ones are between usual / spread and usual * spread.
        limits: smallest and largest factor.
        unit_source: source of the file's unit: option, format or estimate.

    Extents are sorted by length here. The shape is the one in whose range the mesh lies, else the one with its
    proportions.
    """
    shapes, extents = np.sort(shapes, axis=1)[:, ::-1], np.sort(extents)[::-1]
    ratios = np.median(shapes / np.maximum(extents, 1e-9), axis=1)
    shown = sizes(extents)
    by_likeness = np.argsort([misfit(shape, extents) for shape in shapes], kind="stable")
    for index in by_likeness:
        if within(ratios[index], spread):
            return Rescale(1.0, shapes[index], f"the mesh of {shown} m is of a plausible size and is not rescaled")
    alike = by_likeness[0]
    ratio = float(ratios[alike])
    if unit_source == "option":
        asked = f"the mesh of {shown} m keeps the size that {OPTION} gives it, though such things usually have"
        return Rescale(1.0, shapes[alike], Caution(Cause.ASSUMED, f"{asked} {sizes(shapes[alike])} m"))
    units = possible_units(extents[0], unit_source)
    fitting = []
    for name, unit in units.items():
        doubted = unit_source == "format" or name in TAKEN_AS_CENTIMETRES
        close = within(ratio / unit, min(spread, CONVINCING) if doubted else spread)
        if close and limits[0] <= unit <= limits[1]:
            fitting.append(name)
    fitting.sort(key=lambda name: abs(np.log(ratio / units[name])))
    if fitting:
        unit = units[fitting[0]]
        others = "".join(f"; {name} would fit as well" for name in fitting[1:])
        read = f"the mesh of {shown} is read as {fitting[0]}, {sizes(extents * unit)} m: scaled by {unit:g}{others}"
        return Rescale(unit, shapes[alike], Caution(Cause.ASSUMED, f"{read}; {OVERRIDE}"))
    scale = float(np.clip(ratio, *limits))
    clamped = "" if scale == ratio else f", clamped from {ratio:.3g}"
    usual = f"the mesh of {shown} m is scaled by {scale:.4g} to the usual {sizes(shapes[alike])} m (median over axes"
    return Rescale(scale, shapes[alike], Caution(Cause.ASSUMED, f"{usual}{clamped}); {OVERRIDE}"))


def possible_units(longest: float, unit_source: str) -> dict[str, float]:
    """Factors that correct a wrong unit, for a mesh with this longest extent [m]."""
    guessed = LIMITS[Role.OBJECT].metres_up_to, LIMITS[Role.OBJECT].centimetres_up_to
    read_as_centimetres = guessed[0] * METRES["cm"] < longest <= guessed[1] * METRES["cm"]
    if unit_source == "format" or not read_as_centimetres:
        return TAKEN_AS_METRES
    return TAKEN_AS_METRES | TAKEN_AS_CENTIMETRES


def within(ratio: float, spread: float) -> bool:
    """Return whether a ratio is neither larger than the spread nor smaller than its inverse."""
    return bool(abs(np.log(ratio)) <= np.log(spread) + SLACK)


def misfit(shape: Array, extents: Array) -> float:
    """Difference of the proportions [-]: the range of the ratios' logarithms over the axes, both largest first."""
    logs = [np.log(np.maximum(one, THINNEST * one[0]) if one[0] > 0.0 else np.ones(3)) for one in (shape, extents)]
    return float(np.ptp(logs[0] - logs[1]))


def sizes(extents: Array) -> str:
    """Extents in words."""
    return " x ".join(f"{extent:.3g}" for extent in extents)
