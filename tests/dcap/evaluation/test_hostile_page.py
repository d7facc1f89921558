"""Names and sentences that are markup or scripts show as text on every page of a run."""

from collections import Counter
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest
from many_methods_run import METHODS, SAMPLES, change_row, many_methods_run

from dcap.evaluation.pages import Row, labels_page
from dcap.evaluation.report import write_report
from dcap.evaluation.run_folder import summary_of
from dcap.scene.writers.labels import FoundThing
from dcap.scene.written_files import object_to_json
from flows.judge_run import read_rows
from flows.output import readable_json

HOSTILE = ("<script>alert(1)</script>", '"><img src=x onerror=alert(1)>', "</script><b>", "javascript:alert(1)",
           "{{ 7 * 7 }}", "' onmouseover='alert(1)")  # fmt: skip


class Markup(HTMLParser):
    """Counts elements with the names of their attributes; keeps what links lead to, and the text."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.elements: Counter[tuple[str, tuple[str, ...]]] = Counter()
        self.links: list[str] = []
        self.text = ""
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """One element."""
        self.elements[tag, tuple(name for name, _ in attrs)] += 1
        self.links += [value or "" for name, value in attrs if name in ("href", "src")]

    def handle_data(self, data: str) -> None:
        """A text."""
        self.text += data


def page_of(folder: Path, texts: dict[str, str], word: str) -> Markup:
    """The page of a run whose samples, sentences and all that a row says are these."""
    run = many_methods_run(folder, prompts=texts)
    for method in METHODS:
        for sample in texts:
            change_row(run, method, sample, scene=word, object=word, base=word, part=word, message=word, reason=word,
                       expected=word)  # fmt: skip
    (run / "placement.json").write_bytes(readable_json({"warnings": [word], "base": {"id": word, "label": word}}))
    rows = read_rows(run)
    write_report(run, rows, summary_of(rows, run=word, wall_s=1.0))
    return Markup((run / "report.html").read_text(encoding="utf-8"))


@pytest.mark.slow
def test_the_page_of_a_hostile_run_has_the_markup_of_a_harmless_one(tmp_path: Path) -> None:
    """The same elements with the same attributes, no other link, and every word as it was given."""
    ids = dict(zip(SAMPLES, HOSTILE, strict=False))
    plain = page_of(tmp_path / "plain", {f"s-{n}": f"sentence {n}" for n in range(len(ids))}, "word")
    for word in HOSTILE:
        markup = page_of(tmp_path / str(HOSTILE.index(word)), {one: one for one in ids.values()}, word)
        assert markup.elements == plain.elements
        assert not any(link.lower().startswith("javascript:") for link in markup.links)
        assert all(one in markup.text for one in (*ids.values(), word))


def test_the_page_of_labels_escapes(tmp_path: Path) -> None:
    """A thing called as a script, in a scene called so."""
    picture = np.zeros((4, 4, 3), np.uint8)

    def markup(word: str) -> Markup:
        thing = FoundThing(1, 0, word, word, 0.5, False, (1.0, 1.0, 1.0), 0.5)
        row = Row(thing, picture, "rgb(1, 2, 3)", word, word)
        return Markup(labels_page(word, picture, [picture], [row], f"dcap place {word}", offline=True))

    for word in HOSTILE:
        assert markup(word).elements == markup("word").elements
        assert markup(word).text.count(word) >= 3


def test_json_within_a_page_ends_no_script() -> None:
    """What is written for programs is no part of a page: placements in 3D come as files of their own."""
    assert "</" in readable_json(object_to_json({"a": "</script>"})).decode()
    page = Path(__file__).parents[3] / "dcap" / "evaluation" / "templates" / "view3d.html"
    text = page.read_text(encoding="utf-8")
    assert not any(word in text for word in ("innerHTML", "document.write", "insertAdjacentHTML", "eval("))
