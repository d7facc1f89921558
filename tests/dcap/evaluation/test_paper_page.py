"""The page of an evaluation: links lead to files, nothing of the rubric is called Table 1, and every sentence of the
paper has a file or a reason."""

import csv
import re
from collections import Counter
from html import unescape
from pathlib import Path
from urllib.parse import unquote

import pytest
from many_methods_run import many_methods_run

from dcap.evaluation.paper_page import SENTENCES, PaperNotes, SceneFacts, paper_sentences, write_paper_page
from dcap.knowledge.kinds import deformable_materials
from flows.benchmark import finish
from flows.judge_run import read_rows

NOTES = PaperNotes("The study is ready: dcap study serve <it>", {"room_9": "no mesh"}, "All samples.")
SCENES = [
    SceneFacts("bedroom", "given", "bedroom.ply", 100, 0, (("bed", ("mattress", "frame")), ("desk", ("top", "leg")))),
    SceneFacts("study", "SuGaR", "output/refined_mesh/m.obj", 200, 7, (("desk", ("top",)), ("wall", ("body",)))),
]


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of three methods with its page."""
    folder = many_methods_run(tmp_path_factory.mktemp("paper") / "paper-rooms")
    done = finish(folder, read_rows(folder), 1.0)
    write_paper_page(folder, done.rows, done.summary, SCENES, NOTES)
    return folder


def table(path: Path) -> list[dict[str, str]]:
    """A table's rows."""
    return list(csv.DictReader(path.read_text().splitlines()))


def test_every_link_leads_to_a_file(run: Path) -> None:
    """Of pages, pictures and tables; places within the page are there as well."""
    page = (run / "index.html").read_text()
    links = {unescape(one) for one in re.findall(r'(?:href|src)="([^"]+)"', page)}
    assert any(one.startswith("tables/") for one in links)
    for link in links:
        path, _, place = link.partition("#")
        assert (run / unquote(path)).exists() if path else f'id="{place}"' in page, link
    assert "&lt;it&gt;" in page
    assert "room_9" in page


def test_only_a_model_makes_a_table_1(run: Path) -> None:
    """A run that the offline rubric scored says that there is none."""
    page = (run / "index.html").read_text()
    assert "No Table 1: no model has judged this run" in page
    assert page.count("<h3>Table 1") == 0


def test_the_same_files_give_the_same_page(run: Path) -> None:
    """To the last byte."""
    names = ("index.html", "tables/dataset.csv", "tables/figure3.csv", "figures/deformable_materials.png")
    before = {name: (run / name).read_bytes() for name in names}
    done = finish(run, read_rows(run), 1.0)
    write_paper_page(run, done.rows, done.summary, SCENES, NOTES)
    assert {name: (run / name).read_bytes() for name in names} == before


def test_both_counts_of_figure_3(run: Path) -> None:
    """A bed is one deformable support; of its parts the mattress is of one deformable material, the frame is not. A
    desk is neither, and a wall carries nothing."""
    first, second = table(run / "tables" / "figure3.csv")
    assert (first["supports"], first["deformable_supports"], first["deformable_materials"]) == ("2", "1", "1")
    assert (second["supports"], second["deformable_supports"], second["deformable_materials"]) == ("1", "0", "0")
    assert deformable_materials([("bed", ("mattress", "frame"))]) == Counter({first["materials"]: 1})
    meshes = table(run / "tables" / "dataset.csv")
    assert [(one["mesh"], one["open_edges"]) for one in meshes] == [("given", "0"), ("SuGaR", "7")]
    for name in ("deformable_supports", "deformable_materials"):
        assert (run / "figures" / f"{name}.png").read_bytes()[1:4] == b"PNG"


def test_every_sentence_has_a_file_or_a_reason(run: Path) -> None:
    """All four sections are there; what has no file of this run says why."""
    found = paper_sentences(run)
    assert len(found) == len(table(SENTENCES))
    assert {"4.1", "4.2", "4.3", "4.4", "Table 1", "Table 2", "Figure 3"} <= {one.section for one in found}
    assert [one.topic for one in found if not one.files and not one.note] == []
    assert any(one.lacking == ("tables/table2.csv", "tables/table2.tex") for one in found)
