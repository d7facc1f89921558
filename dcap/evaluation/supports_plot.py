"""The deformable supports per scene as a plot and as a table: the paper's figure 3, and their kinds."""

import csv
import io
from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from math import ceil
from pathlib import Path
from statistics import mean, median

from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from matplotlib.typing import RcKeyType

from dcap.knowledge.kinds import KINDS, OTHER, deformable_supports
from dcap.knowledge.lexicon import first_part, is_a, thing_of
from dcap.scene.errors import InputError
from dcap.scene.written_files import whole_file

SUPPORTS, MATERIALS = "deformable supports", "deformable materials"
"""Counted things, as words of the plot."""
RUG = "rug"
"""The kind that lies on the floor."""
SUFFIXES = (".png", ".svg")
SIZE = (10.8, 4.7)
"""Width and height [inch]."""
DPI = 200
INK, GREY, PALE = "#222222", "#6b7280", "#e5e7eb"
BLUE, SAND = "#3b6ea5", "#c9a227"
"""Colours of scenes with deformable supports, and without."""
MOST_BARS = 20
"""Most bars of the histogram; more counts share bars [-]."""
LETTERS = 72
"""Number of letters that fit below the histogram side by side [-]."""
ROOM_FOR_NOTES = 1.35
"""Length of the axis of kinds over its longest bar: the numbers are beyond the bars [-]."""
STYLE: dict[RcKeyType, object] = {
    "font.size": 9.0, "svg.hashsalt": "dcap", "svg.fonttype": "none", "text.color": INK, "text.parse_math": False,
    "axes.edgecolor": GREY, "axes.labelcolor": GREY, "xtick.color": INK, "ytick.color": INK,
}  # fmt: skip
"""Keeps text as text in an SVG, and gives equal files for equal plots."""
SHOWN = (*KINDS, OTHER)
COLUMNS = ("scene", "instances", "supports", "deformable", "share", *SHOWN)


def plot_suffix(path: Path) -> str:
    """The suffix of a plot's file; InputError for an unsupported one."""
    suffix = path.suffix.lower()
    if suffix not in SUFFIXES:
        raise InputError(f"{path}: a plot is saved as {' or '.join(SUFFIXES)}, not as {suffix or 'no suffix'}")
    return suffix


def save_supports_plot(scenes: Sequence[Counter[str]], path: Path, what: str = SUPPORTS) -> None:
    """Write the plot of the kinds of deformable supports, or of `what` else, that each scene has, as PNG or SVG by the
    path's suffix; InputError for another suffix, or if it cannot be written."""
    suffix = plot_suffix(path)
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with rc_context(STYLE), whole_file(path) as draft:
            # a date would change every file
            supports_plot(scenes, what).savefig(draft, dpi=DPI, metadata={"Date": None} if suffix == ".svg" else None)
    except OSError as error:
        raise InputError(f"{path}: cannot be written: {error.strerror}") from None


def supports_plot(scenes: Sequence[Counter[str]], what: str = SUPPORTS) -> Figure:
    """The plot: a histogram of their number in a scene, and the frequency of each kind."""
    with rc_context(STYLE):
        figure = Figure(SIZE, layout="constrained")
        figure.suptitle(f"{what.capitalize()} per scene", x=0.02, ha="left", fontsize=15)
        counts_axes, kinds_axes = figure.subplots(1, 2, width_ratios=(3, 2))
        counts_axes.set_title(summary(scenes).replace("; ", "\n"), loc="left", color=GREY, fontsize=9)
        _histogram(counts_axes, [one.total() for one in scenes], f"{what} in a scene")
        _kinds(kinds_axes, scenes)
    return figure


def summary(kinds: Sequence[Counter[str]]) -> str:
    """The distribution in a line; scenes with nothing but rugs, which lie on the floor, are counted separately."""
    if not kinds:
        return "no scene"
    counts = [one.total() for one in kinds]
    some, other = sum(count > 0 for count in counts), sum(one.total() > one[RUG] for one in kinds)
    scenes = f"{len(counts)} scene{'s' if len(counts) != 1 else ''}"
    scenes += f", {some} ({100 * some / len(counts):.0f} %) with at least one"
    scenes += f", {other} ({100 * other / len(counts):.0f} %) with more than rugs" if other < some else ""
    return f"{scenes}; median {median(counts):g}, mean {mean(counts):.1f}, {sum(counts)} in all"


def bins(counts: Sequence[int]) -> list[tuple[str, int, bool]]:
    """Label, number of scenes and whether there is any support, for each bar of the histogram."""
    most = max(counts, default=0)
    step = next(s for s in (1, *(m * 10**e for e in range(12) for m in (2, 5, 10))) if most / s <= MOST_BARS)
    bars = [("0", sum(count == 0 for count in counts), False)]
    for low in range(1, most + 1, step):
        label = f"{low}" if step == 1 else f"{low}-{low + step - 1}"
        bars.append((label, sum(low <= count < low + step for count in counts), True))
    return bars


def _histogram(axes: Axes, counts: Sequence[int], words: str) -> None:
    bars = bins(counts)
    drawn = axes.bar(
        range(len(bars)), [scenes for _, scenes, _ in bars], 0.78, color=[BLUE if soft else SAND for *_, soft in bars]
    )
    axes.bar_label(drawn, [str(scenes) if scenes else "" for _, scenes, _ in bars], padding=2)
    every = ceil(len(bars) * (max(len(label) for label, *_ in bars) + 2) / LETTERS)  # keeps labels apart
    axes.set_xticks(range(0, len(bars), every), [label for label, *_ in bars[::every]])
    axes.set_xlim(-0.6, max(len(bars), 4) - 0.4)
    top = 1.08 * max(1, *(scenes for _, scenes, _ in bars))
    axes.set_ylim(0, top)
    marks = MaxNLocator(6, integer=True).tick_values(0, top)
    axes.set_yticks([mark for mark in marks if mark <= top])
    axes.yaxis.grid(visible=True, color=PALE)
    axes.set_axisbelow(True)
    axes.spines[["top", "right", "left"]].set_visible(False)
    axes.tick_params(length=0)
    axes.set_xlabel(words)
    axes.set_ylabel("scenes")


def _kinds(axes: Axes, scenes: Sequence[Counter[str]]) -> None:
    total: Counter[str] = sum(scenes, Counter())
    rows = total.most_common()
    axes.set_title("kinds, and the number of scenes with each" if rows else "none", loc="left", color=GREY, fontsize=9)
    axes.spines[:].set_visible(False)
    axes.tick_params(length=0)
    axes.set_xticks([])
    axes.set_yticks(range(len(rows)), [kind for kind, _ in rows])
    if rows:
        drawn = axes.barh(range(len(rows)), [count for _, count in rows], 0.66, color=BLUE)
        axes.bar_label(drawn, [f"{count} in {sum(kind in one for one in scenes)}" for kind, count in rows], padding=3)
        axes.set_xlim(0, ROOM_FOR_NOTES * rows[0][1])
        axes.set_ylim(max(len(rows), 6) - 0.4, -0.6)


def is_support(label: str) -> bool:
    """Whether a label names a support: furniture and rugs with a carrying part, or a deformable thing."""
    thing = thing_of(label)
    carries = thing is not None and not is_a(thing.id, "structure") and first_part(thing.id) != ""
    return carries or deformable_supports([label]).total() > 0


def supports_table(scenes: Mapping[str, Sequence[str]]) -> str:
    """CSV of the scenes, given as the labels of their instances by name, and a last row of all of them.

    `share` is the share of deformable supports among supports [-], empty without supports.
    """
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    table.writerow(COLUMNS)
    for name, labels in scenes.items():
        table.writerow(row_of_labels(name, labels))
    table.writerow(row_of_labels("all", [label for labels in scenes.values() for label in labels]))
    return text.getvalue()


def row_of_labels(name: str, labels: Iterable[str]) -> list[object]:
    """Counts of one scene."""
    known = list(labels)
    kinds: Counter[str] = deformable_supports(known)
    supports = sum(is_support(label) for label in known)
    share = f"{kinds.total() / supports:.4f}" if supports else ""
    return [name, len(known), supports, kinds.total(), share, *(kinds[kind] for kind in SHOWN)]
