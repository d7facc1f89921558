"""The plot of deformable supports per scene: right numbers, readable words."""

from collections import Counter
from xml.etree import ElementTree

from hypothesis import given, settings
from hypothesis import strategies as st

from dcap.evaluation.drawing import Bar, Drawing, Words, text_width
from dcap.evaluation.supports_plot import bins, summary, supports_drawing, ticks

KINDS = ["bed", "sofa", "soft seat", "mattress", "pillow or cushion", "blanket or towel", "soft toy", "rug", "other"]
scenes = st.lists(st.dictionaries(st.sampled_from(KINDS), st.integers(1, 90)).map(Counter), max_size=30)


@given(st.lists(st.integers(0, 3000)))
def test_every_scene_is_in_one_bar(counts: list[int]) -> None:
    """The bars share the scenes out, those without any support apart."""
    bars = bins(counts)
    assert sum(number for _, number, _ in bars) == len(counts)
    assert bars[0] == ("0", counts.count(0), False)
    assert len(bars) <= 21


@given(st.integers(0, 10**6))
def test_ticks_reach_the_highest_bar(most: int) -> None:
    """From zero, evenly, and not many."""
    marks = ticks(most)
    assert marks[0] == 0
    assert marks[-1] >= most
    assert len(marks) <= 7


@given(scenes)
@settings(max_examples=30)
def test_words_neither_overlap_nor_leave_the_sheet(kinds: list[Counter[str]]) -> None:
    """For any numbers: upright texts keep apart from each other and within the sheet, and bars within it too."""
    drawing = supports_drawing(kinds)
    texts = [box_of(one) for one in drawing.shapes if isinstance(one, Words) and one.upright]
    for index, (left, top, right, bottom) in enumerate(texts):
        assert 0 <= left < right <= drawing.width
        assert 0 <= top < bottom <= drawing.height
        for other in texts[index + 1 :]:
            apart = other[0] >= right or other[2] <= left or other[1] >= bottom or other[3] <= top
            assert apart, (texts[index], other)
    for one in drawing.shapes:
        assert not isinstance(one, Bar) or 0 <= one.box[0] <= one.box[2] <= drawing.width


def box_of(one: Words) -> tuple[float, float, float, float]:
    """Left, top, right, bottom of a line of text, by the height of its capitals."""
    width = text_width(one.text, one.size)
    left = one.at[0] - {"start": 0.0, "middle": 0.5, "end": 1.0}[one.anchor] * width
    return left, one.at[1] - 0.75 * one.size, left + width, one.at[1]


def test_the_summary_counts() -> None:
    """Three scenes, one with a rug only, one with nothing."""
    line = summary([Counter(bed=1, rug=1), Counter(rug=1), Counter()])
    assert line.startswith("3 scenes, 2 (67 %) with at least one, 1 (33 %) with more than rugs; median 1, mean 1.0, 3")


def test_picture_and_vectors_show_the_same() -> None:
    """As many shapes in the SVG, which is well-formed; bars of their colour in the picture."""
    drawing = Drawing(100, 50, [Bar((10, 10, 40, 30), "#3b6ea5"), Words((50, 40), "a < b & c")])
    assert drawing.picture().getpixel((50, 40)) == (0x3B, 0x6E, 0xA5)
    tree = ElementTree.fromstring(drawing.svg())
    assert [child.tag.rpartition("}")[2] for child in tree] == ["rect", "rect", "text"]
    assert tree[2].text == "a < b & c"
