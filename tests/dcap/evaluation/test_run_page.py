"""The page of a run of several methods: strips, tables, causes, provenance, 3D, and nothing that code could hide in."""

import base64
import csv
import gzip
import hashlib
import json
import re
import shutil
from dataclasses import replace
from html.parser import HTMLParser
from pathlib import Path

import pytest
from many_methods_run import METHODS, SAMPLES, many_methods_run, method_folder
from run_rows import outcomes, written

from dcap.evaluation.outcome_table import SampleOutcome, row_of
from dcap.evaluation.run_page.placement_files import MOST_NOTES, certificate_text, notes_of
from dcap.evaluation.run_page.sections import failures_of, provenance_of, supports_figure
from dcap.evaluation.run_page.tables import SHOWN_METRICS, metrics_table, table_from_csv
from dcap.evaluation.table_files import tex_escaped
from dcap.evaluation.view3d import three_script
from dcap.scene.readers.gltf.gltf import read_gltf
from dcap.scene.types.pictures import PLACED
from dcap.scene.types.sample import Sample

VOID = {"meta", "img", "input", "br", "link"}


class WholePage(HTMLParser):
    """Elements of a page, and whether each is closed by its own end."""

    def __init__(self, page: str) -> None:
        super().__init__()
        self.open: list[str] = []
        self.elements: list[tuple[str, dict[str, str | None]]] = []
        self.feed(page)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        """A new element."""
        self.elements.append((tag, dict(attrs)))
        if tag not in VOID:
            self.open.append(tag)

    def handle_endtag(self, tag: str) -> None:
        """The end of the last one."""
        assert self.open.pop() == tag

    def all(self, tag: str) -> list[dict[str, str | None]]:
        """Attributes of the elements of a kind."""
        return [attributes for name, attributes in self.elements if name == tag]


@pytest.fixture(scope="module")
def run(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run of three methods with its page."""
    folder = many_methods_run(tmp_path_factory.mktemp("runs") / "run")
    written(folder, outcomes(folder))
    return folder


def test_each_sample_is_a_strip_of_all_methods(run: Path) -> None:
    """The same view of each method side by side, every file that is named is there, and texts are escaped."""
    text = (run / "report.html").read_text(encoding="utf-8")
    page = WholePage(text)
    assert page.open == []
    articles = [one for one in page.all("article") if one["class"] == "card compared"]
    assert [one["id"] for one in articles] == list(SAMPLES)
    cells = [one for one in page.all("section") if one.get("class") == "cell"]
    assert [one["data-method"] for one in cells] == [*METHODS] * len(SAMPLES)
    pictures = [one for one in page.all("img") if "data-views" in one]
    assert {one["data-views"] for one in pictures} == {"|".join(f"views/{name}.png" for name in PLACED)}
    assert len(pictures) == len(cells)
    for one in page.all("img"):
        assert (run / str(one["src"])).is_file()
        assert one["loading"] == "lazy"
    for one in page.all("a"):
        link = str(one["href"]).partition("#")[0]
        assert not link or (run / link).exists(), link
    assert "put the ball &lt;b&gt;near&lt;/b&gt; the pillow &amp; leave it" in text
    assert not re.search(r"""(?:src|href)=["']?(?:https?:)?//""", text)


def test_the_same_run_gives_the_same_files(run: Path, tmp_path: Path) -> None:
    """Page, tables, figures, digests and 3D, written again and from a copy."""
    copy = tmp_path / "run"
    shutil.copytree(run, copy)
    shutil.rmtree(copy / "view3d")
    written(copy, outcomes(copy))
    files = sorted(path.relative_to(run) for path in run.rglob("*") if path.is_file())
    assert files == sorted(path.relative_to(copy) for path in copy.rglob("*") if path.is_file())
    assert [str(one) for one in files if (run / one).read_bytes() != (copy / one).read_bytes()] == []


def test_a_model_is_a_script_with_the_placement(run: Path) -> None:
    """A page from disk may load scripts only: each holds the cut-out as GLB; an object that is left where it was does
    not write it again."""
    if not three_script():
        pytest.skip("the installed trimesh carries no three.js")
    path = run / "view3d" / "methods" / "fireplace" / "samples" / "sofa_3.js"
    mark, call = path.read_text().splitlines()
    source = method_folder(run, "fireplace", "sofa/3") / "scene.glb"
    assert hashlib.sha256(source.read_bytes()).hexdigest() in mark
    packed = re.fullmatch(r'window\.dcapModel\("methods/fireplace/samples/sofa_3", "([^"]+)"\);', call)
    assert packed is not None
    model = path.with_suffix(".glb")
    model.write_bytes(gzip.decompress(base64.b64decode(packed.group(1))))
    assert "object" in read_gltf(model).node_names
    model.unlink()
    path.write_text(f"{mark}\nkept")
    written(run, outcomes(run))
    assert path.read_text() == f"{mark}\nkept"
    path.write_text("// of another scene\n")
    written(run, outcomes(run))
    assert path.read_text() == f"{mark}\n{call}\n"


def test_metrics_are_told_in_raw_units(run: Path) -> None:
    """SI in the CSV, with counts; the page has millimetres, a share of hits, and n where some are unknown."""
    rows = list(csv.DictReader((run / "tables" / "metrics.csv").read_text().splitlines()))
    deep = next(one for one in rows if (one["method"], one["metric"]) == ("layoutgpt", "penetration_m"))
    assert (deep["n"], deep["median"], deep["mean"], deep["largest"]) == ("4", "0.002", "0.002", "0.002")
    drift = next(one for one in rows if (one["method"], one["metric"]) == ("fireplace", "drift_m"))
    assert (drift["n"], drift["median"]) == ("0", "")
    own = outcomes(run)
    by_method = {name: [row for row in own if row.method == name] for name in METHODS}
    by_method["layoutgpt"][0] = replace(by_method["layoutgpt"][0], penetration_m=None)
    table = metrics_table(run, by_method, {name: name for name in METHODS})
    assert table is not None
    found = {row[0]: row[1:] for row in table.rows}
    assert found["placed"] == ("4 of 4",) * 3
    assert found["support hit [%]"] == ("100", "100", "0")
    assert found["penetration [mm]"] == ("0 (0)", "1 (1)", "2 (2), n 3")
    assert found["drift (ours) [mm]"] == ("0.1 (0.1)", "–", "–")
    lines = (run / "tables" / "metrics.tex").read_text().splitlines()
    assert "penetration [mm] & 0 (0) & 1 (1) & 2 (2), n 3 \\\\" in lines
    assert sum(", n " in one for one in lines) == 1
    written(run, own)


def test_every_shown_metric_is_a_column() -> None:
    """Each is a field of a row, and none is told twice."""
    columns = [one.column for one in SHOWN_METRICS]
    assert len(set(columns)) == len(columns)
    assert set(columns) <= set(SampleOutcome.__dataclass_fields__)


def test_failures_tell_why() -> None:
    """An error, a refusal that nobody intended, another outcome than intended, a low score with its worst metric."""
    good = row_of(Sample("a", "s", "o", "p"), {"verdict": "at_rest", "base": {"id": "1", "label": "bed"}}, "", None)
    rows = [
        replace(good, sample="good", right_place=8.0, physics_naturalness=8.0),
        replace(good, sample="low", right_place=9.0, physics_naturalness=2.0, penetration_m=0.05, visible_fraction=1.0),
        replace(good, sample="elsewhere", as_expected=False, expected="at rest on sofa"),
        replace(good, sample="refused", verdict="infeasible", reason="toppled", message="it fell"),
        replace(good, sample="right refusal", verdict="infeasible", feasible_intended=False, as_expected=True),
        replace(good, sample="broken", verdict="failed", error="o: no such file"),
    ]
    found = {one.row.sample: (one.kinds, one.causes) for one in failures_of(rows)}
    assert found == {
        "broken": (("failed",), ("o: no such file",)),
        "refused": (("infeasible",), ("toppled: it fell",)),
        "elsewhere": (("not as intended",), ("intended: at rest on sofa; came out: at rest on bed",)),
        "low": (("low score",), ("P&N 2.0, worst metric penetration_m 0.05 (1.0)",)),
    }
    assert list(found) == ["broken", "refused", "elsewhere", "low"]


def test_tables_of_the_run_are_shown(tmp_path: Path) -> None:
    """Spread, interval and mark belong to their value; what all rows share is said once; a torn table is left out."""
    (tmp_path / "tables").mkdir()
    path = tmp_path / "tables" / "table2.csv"
    path.write_text("method,name,overall_wins,overall_low,overall_high,overall_p,overall_significant,elo,score,score_sd,judge,fair\n"
                    "dcap,DCAP,0.9000,0.8000,0.9512,0.001,True,1600.26,9.4832,1.0335,rubric,False\n"
                    "x,<i>X</i>,0.1000,,,0.5,False,,4,,rubric,False\n")  # fmt: skip
    table = table_from_csv(tmp_path, "table2", "Table 2")
    assert table is not None
    assert table.head == ("name", "overall wins", "Elo", "score")
    assert table.rows == (("DCAP", "0.90† [0.80, 0.95]", "1600", "9.48 ± 1.03"), ("<i>X</i>", "0.10", "–", "4"))
    assert table.note == "In every row: judge rubric; fair no"
    assert table.files == ("tables/table2.csv",)
    path.write_text("method,name\ndcap\n")
    assert table_from_csv(tmp_path, "table2", "Table 2") is None
    assert table_from_csv(tmp_path, "table1", "Table 1") is None


def test_tex_has_no_commands_of_a_name() -> None:
    """What TeX would take for something else is escaped."""
    assert tex_escaped("a_b & 5 % \\x [°]") == "a\\_b \\& 5 \\% \\textbackslash{}x [$^\\circ$]"


def test_digests_can_be_checked(run: Path) -> None:
    """The list has every placement's files with the digests that sha256sum finds."""
    lines = (run / "artifacts.sha256").read_text().splitlines()
    found = {path: digest for digest, path in (line.split("  ", 1) for line in lines)}
    assert {f"samples/{one}/scene.glb" for one in ("bed-1", "bed-2", "sofa_3", "desk-4")} < set(found)
    assert "methods/layoutgpt/samples/bed-1/placement.json" in found
    for path, digest in found.items():
        assert hashlib.sha256((run / path).read_bytes()).hexdigest() == digest


def test_provenance_is_that_of_run_json(tmp_path: Path) -> None:
    """Versions, seeds with their places, and a digest of the configuration whatever the order of its keys."""
    config = {"drop": {"solver": {"seed": 7, "method": "tl"}}, "measured": True}
    asked = {"versions": {"dcap": "1.2", "numpy": "<2>"}, "config": config, "started": "2026-01-02T03:04:05+00:00",
             "samples": [{"id": str(n), "seed": n} for n in range(5)],
             "language": {"model": "", "max_cost": None}}  # fmt: skip
    found = []
    for text in (json.dumps(asked), json.dumps(asked | {"config": dict(reversed(config.items()))})):
        (tmp_path / "run.json").write_text(text)
        found.append(provenance_of(tmp_path, []))
    facts = dict(found[0].facts)
    assert facts["seeds of the configuration"] == "drop.solver.seed 7"
    assert (facts["seeds of samples"], facts["language"]) == ("0 to 4", "offline")
    assert facts["digest of the configuration"] == dict(found[1].facts)["digest of the configuration"]
    assert found[0].versions == (("dcap", "1.2"), ("numpy", "<2>"))
    assert "numpy</dt><dd>&lt;2&gt;" in written(tmp_path, [])
    assert found[0].files == 0


@pytest.mark.parametrize(("client", "says"), [("offline", True), ("anthropic", False), ("", False)])
def test_a_page_says_that_nobody_looked(tmp_path: Path, client: str, says: bool) -> None:
    """Where the embedded reader placed; not where a model did, or nobody knows."""
    config = {"intent": {"language": {"client": client}}} if client else {}
    (tmp_path / "run.json").write_text(json.dumps({"config": config}))
    assert ("no model looked at pictures" in written(tmp_path, [])) == says


def test_figure_3_counts_scenes_once(tmp_path: Path) -> None:
    """What was placed is not part of the scene, two samples of a scene count once, and unknown scenes are told."""
    things = [{"id": str(n), "label": label} for n, label in enumerate(("bed", "desk", "cushion"))]
    rows = []
    for sample, scene in (("a", "room"), ("b", "room"), ("c", "other")):
        rows.append(row_of(Sample(sample, scene, "o", "p"), {"verdict": "at_rest"}, "", None))
        folder = tmp_path / "samples" / sample
        folder.mkdir(parents=True)
        if scene == "room":
            (folder / "scene.json").write_text(json.dumps({"object": "2", "instances": things}))
    figure = supports_figure(tmp_path, rows)
    assert figure is not None
    assert (figure.scenes, figure.known) == (2, 1)
    assert figure.words.endswith("1 in all")
    assert "1 of 2 scenes of this run are not counted" in written(tmp_path, rows)
    assert supports_figure(tmp_path, rows[2:]) is None


def test_a_certificate_is_lines_and_notes_are_bounded() -> None:
    """One line for each row, with its threshold; many notes are cut and counted."""
    tree = {
        "certificate": {"arch": "cpu", "signals": {"box_change": {"margin": 0.5, "threshold": 2e-5, "value": 1e-5}},
                        "kick": {"stable": True}, "column": [{"part": "mattress", "from_m": 0.0}]},
        "contacts": [{"a": "object", "b": "4", "area_m2": 0.001}],
        "warnings": ["x" * 1000] * (MOST_NOTES + 3),
    }  # fmt: skip
    assert certificate_text(tree).splitlines() == [
        "arch                cpu",
        "signals.box_change       1e-05   margin 0.5, threshold 2e-05",
        "kick.stable         yes",
        "column 1            part mattress, from_m 0",
        "contact 1           a object, b 4, area_m2 0.001",
    ]
    notes = notes_of(tree)
    assert notes[-1] == "3 more in placement.json"
    assert max(map(len, notes)) < 310


def test_the_page_of_a_large_run_is_bounded(run: Path) -> None:
    """A thousand placements take less than 8 MB, and the gallery of failures ends."""
    rows = [
        replace(row, sample=f"s{number}", error="it broke " * 100 if number % 2 else "")
        for row in outcomes(run)[::4]
        for number in range(334)
    ]
    text = written(run, rows)
    written(run, outcomes(run))
    assert text.count('class="cell"') == len(rows) == 1002
    assert text.count('class="fault"') == 120
    assert len(text) < 8e6
