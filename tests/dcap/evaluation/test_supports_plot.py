"""The plot of deformable supports per scene: right numbers, readable words."""

from collections import Counter
from pathlib import Path
from xml.etree import ElementTree

import pytest
from hypothesis import Phase, given, settings
from hypothesis import strategies as st
from matplotlib.artist import Artist
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.text import Text
from PIL import Image

from dcap.evaluation.supports_plot import bins, save_supports_plot, summary, supports_plot
from dcap.scene.errors import InputError

KINDS = ["bed", "sofa", "soft seat", "mattress", "pillow or cushion", "blanket or towel", "soft toy", "rug", "other"]
scenes = st.lists(st.dictionaries(st.sampled_from(KINDS), st.integers(1, 90)).map(Counter), max_size=30)


@given(st.lists(st.integers(0, 3000)))
def test_every_scene_is_in_one_bar(counts: list[int]) -> None:
    """The bars share the scenes out, those without any support apart."""
    bars = bins(counts)
    assert sum(number for _, number, _ in bars) == len(counts)
    assert bars[0] == ("0", counts.count(0), False)
    assert len(bars) <= 21


@given(scenes)
@settings(max_examples=8, deadline=None, phases=[Phase.generate])
def test_words_neither_overlap_nor_leave_the_sheet(kinds: list[Counter[str]]) -> None:
    """For any numbers: texts keep apart from each other and within the sheet."""
    figure = supports_plot(kinds)
    FigureCanvasAgg(figure).draw()
    boxes = [box for one in figure.findobj(Text) if shown(one) and (box := one.get_window_extent()).width > 0]
    width, height = figure.bbox.size
    for index, one in enumerate(boxes):
        assert one.x0 >= 0
        assert one.x1 <= width
        assert one.y0 >= 0
        assert one.y1 <= height
        assert not any(one.overlaps(other) for other in boxes[index + 1 :])


def shown(one: Artist) -> bool:
    return one.get_visible() and isinstance(one, Text) and bool(one.get_text())


def test_the_summary_counts() -> None:
    """Three scenes, one with a rug only, one with nothing."""
    line = summary([Counter(bed=1, rug=1), Counter(rug=1), Counter()])
    assert line.startswith("3 scenes, 2 (67 %) with at least one, 1 (33 %) with more than rugs; median 1, mean 1.0, 3")


def test_a_plot_is_the_same_file_each_time_and_its_words_are_words(tmp_path: Path) -> None:
    """Two SVG files of the same scenes are equal, well-formed, and say how many there are of what."""
    kinds = [Counter({"bed": 2, "a < b & c": 1}), Counter()]
    for name in ("one.svg", "two.svg"):
        save_supports_plot(kinds, tmp_path / "plots" / name)
    one, two = ((tmp_path / "plots" / name).read_bytes() for name in ("one.svg", "two.svg"))
    assert one == two
    words = [element.text for element in ElementTree.fromstring(one).iter() if element.tag.endswith("}text")]
    assert {"a < b & c", "2 in 1", "Deformable supports per scene"} <= set(words)


def test_a_picture_is_a_picture(tmp_path: Path) -> None:
    """A PNG in the colours of the bars."""
    save_supports_plot([Counter(bed=1), Counter()], tmp_path / "plot.png")
    colors = {color for _, color in Image.open(tmp_path / "plot.png").convert("RGB").getcolors(1 << 24) or []}
    assert {(0x3B, 0x6E, 0xA5), (0xC9, 0xA2, 0x27)} <= colors


def test_other_files_are_refused(tmp_path: Path) -> None:
    """A suffix that no plot has is named."""
    with pytest.raises(InputError, match=r"plot\.pdf: a plot is saved as \.png or \.svg, not as \.pdf"):
        save_supports_plot([], tmp_path / "plot.pdf")
