"""The distribution of deformable supports per scene as a drawing: the paper's figure 3, and what kinds they are."""

from collections import Counter
from collections.abc import Sequence
from math import ceil
from statistics import mean, median

from dcap.evaluation.drawing import Bar, Drawing, Line, Words, text_width

RUG = "rug"
"""The kind of what lies on the floor."""
WIDTH, HEIGHT = 1080, 470
TOP, BOTTOM = 118, 404
"""Upper and lower end of the bars."""
LEFT, MIDDLE = 74, 596
"""Left and right end of the histogram."""
INK, GREY, PALE = "#222222", "#6b7280", "#e5e7eb"
BLUE, SAND = "#3b6ea5", "#c9a227"
"""Colours of scenes with deformable supports, and of what has none."""
MOST_BARS = 20
"""More counts than these share bars [-]."""
ROW = 34.0
"""Height of a row of kinds."""


def supports_drawing(scenes: Sequence[Counter[str]]) -> Drawing:
    """The drawing of the kinds of deformable supports that each scene has."""
    drawing = Drawing(WIDTH, HEIGHT)
    counts = [one.total() for one in scenes]
    _head(drawing, summary(scenes))
    _histogram(drawing, counts)
    _kinds(drawing, scenes)
    return drawing


def _head(drawing: Drawing, line: str) -> None:
    title = "Deformable supports per scene"
    drawing.shapes.append(Words((LEFT - 48, 40), title, 22, INK))
    drawing.shapes.append(Words((LEFT - 48, 66), line, 13.5, GREY))


def summary(kinds: Sequence[Counter[str]]) -> str:
    """The distribution in a line; rugs lie on the floor, so scenes that have nothing else are told apart."""
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


def ticks(most: int) -> list[int]:
    """Round numbers from 0 up to at least `most`, at most seven."""
    step = next(m * 10**e for e in range(12) for m in (1, 2, 5) if most <= 5 * m * 10**e)
    return list(range(0, most + step, step))


def _histogram(drawing: Drawing, counts: Sequence[int]) -> None:
    bars = bins(counts)
    marks = ticks(max(scenes for _, scenes, _ in bars))
    unit = (BOTTOM - TOP) / max(marks[-1], 1)
    for mark in marks:
        y = BOTTOM - mark * unit
        drawing.shapes.append(Line((LEFT, y, MIDDLE, y), GREY if mark == 0 else PALE))
        drawing.shapes.append(Words((LEFT - 10, y + 4), str(mark), 12, GREY, "end"))
    pitch = (MIDDLE - LEFT) / len(bars)
    every = ceil((max(text_width(label, 12) for label, _, _ in bars) + 8) / pitch)  # so that labels keep apart
    for index, (label, scenes, soft) in enumerate(bars):
        center, half = LEFT + (index + 0.5) * pitch, min(0.39 * pitch, 32.0)
        top = BOTTOM - scenes * unit
        drawing.shapes.append(Bar((center - half, top, center + half, BOTTOM), BLUE if soft else SAND, 1.5))
        if scenes and pitch > 16:
            drawing.shapes.append(Words((center, top - 6), str(scenes), 12, INK, "middle"))
        if index % every == 0:
            drawing.shapes.append(Words((center, BOTTOM + 19), label, 12, INK, "middle"))
    drawing.shapes.append(
        Words(((LEFT + MIDDLE) / 2, BOTTOM + 44), "deformable supports in a scene", 13, GREY, "middle")
    )
    drawing.shapes.append(Words((LEFT - 38, (TOP + BOTTOM) / 2), "scenes", 13, GREY, "middle", upright=False))


def _kinds(drawing: Drawing, scenes: Sequence[Counter[str]]) -> None:
    total: Counter[str] = sum(scenes, Counter())
    begin = MIDDLE + 64
    drawing.shapes.append(Words((begin, TOP - 22), "what they are, and in how many scenes", 13, GREY))
    rows = total.most_common()
    if not rows:
        drawing.shapes.append(Words((begin, TOP + 16), "none", 13, INK))
        return
    zero = begin + max(text_width(kind, 13) for kind, _ in rows) + 14
    notes = [f"{count} in {sum(kind in scene for scene in scenes)}" for kind, count in rows]
    room = WIDTH - 36 - zero - max(text_width(note, 12) for note in notes) - 8
    row = min(ROW, (BOTTOM - TOP) / len(rows))
    for index, ((kind, count), note) in enumerate(zip(rows, notes, strict=True)):
        middle = TOP + (index + 0.5) * row
        end = zero + room * count / rows[0][1]
        drawing.shapes.append(Words((zero - 10, middle + 4.5), kind, 13, INK, "end"))
        drawing.shapes.append(Bar((zero, middle - 0.33 * row, end, middle + 0.33 * row), BLUE, 1.5))
        drawing.shapes.append(Words((end + 7, middle + 4.5), note, 12, GREY))
