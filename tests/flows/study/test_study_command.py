"""`dcap study serve|report` as a person types it: what is refused, and what a report writes."""

import csv
import shutil
import socket
from dataclasses import replace
from pathlib import Path

import pyarrow.parquet as pq
import pytest
import uvicorn
from many_methods_run import SAMPLES, change_row, many_methods_run
from ports import free_port
from study_server import ServedStudy

from dcap.evaluation.run_folder import sample_folder
from dcap.evaluation.statistics.comparisons import AXES
from dcap.evaluation.study.design import Side, read_study_run
from dcap.evaluation.study.study_folder import STUDY_FOLDER, read_design, tokens_for, write_design
from flows.cli.app import main
from flows.judge_run import read_rows
from flows.scoring import MEASURES, changed_since, states_of
from flows.study import serve
from flows.study.serve import StudyOptions, report_study, shown_host


def complaint(capsys: pytest.CaptureFixture[str], *arguments: object) -> str:
    """The line that a refused command says."""
    assert main(["study", *map(str, arguments)]) == 2
    said = capsys.readouterr().err.strip()
    assert len(said.splitlines()) == 1
    return said


@pytest.fixture
def run(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A run of three methods in a data folder of its own."""
    monkeypatch.setenv("DCAP_DATA", str(tmp_path / "data"))
    return many_methods_run(tmp_path / "data" / "runs" / "compared")


@pytest.mark.parametrize("command", ["serve", "report"])
def test_a_run_that_is_not_there(run: Path, command: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert "'nothing' is not a run; there are compared" in complaint(capsys, command, "nothing")


def test_one_method_is_no_study(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    one = many_methods_run(tmp_path / "one", ("dcap",))
    assert "one: a study compares methods, and the run has only dcap" in complaint(capsys, "serve", one)
    assert not (one / STUDY_FOLDER).exists()


def test_a_run_without_renders(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    for picture in run.rglob("*.png"):
        picture.unlink()
    assert "run.json: " in complaint(capsys, "serve", "compared")
    assert not (run / STUDY_FOLDER).exists()


def test_a_port_that_is_taken(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    with socket.socket() as other:
        other.bind(("127.0.0.1", 0))
        other.listen()
        port = other.getsockname()[1]
        said = complaint(capsys, "serve", run, "--port", port)
    assert f"--port {port}: 127.0.0.1 cannot listen there (Address already in use); give another" in said
    assert not (run / STUDY_FOLDER).exists()


def test_a_host_that_is_not_ours(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert "--host no.such.host.invalid" in complaint(capsys, "serve", run, "--host", "no.such.host.invalid")


def test_too_few_comparisons(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert "--pairs 2: there are 3 pairs of methods" in complaint(capsys, "serve", run, "--port", 1024, "--pairs", 2)


def test_a_study_is_served_by_one(study: ServedStudy, capsys: pytest.CaptureFixture[str]) -> None:
    assert "its study is served already" in complaint(capsys, "serve", study.run, "--port", free_port())


@pytest.mark.parametrize(("option", "value", "words"), [
    ("--seed", 5, "--seed 5: the study in"), ("--pairs", 3, "--pairs 3: the study in"),
])  # fmt: skip
def test_what_was_designed_stays(
    study: ServedStudy, capsys: pytest.CaptureFixture[str], option: str, value: int, words: str
) -> None:
    before = (study.folder / "study.json").read_bytes()
    assert words in complaint(capsys, "serve", study.run, option, value)
    assert (study.folder / "study.json").read_bytes() == before


def test_a_study_of_which_a_placement_is_gone(study: ServedStudy, capsys: pytest.CaptureFixture[str]) -> None:
    shutil.rmtree(study.run / "methods" / "layoutgpt")
    assert "methods/layoutgpt/samples" in complaint(capsys, "serve", study.run, "--port", free_port())


def test_a_study_of_which_a_check_is_gone(study: ServedStudy, capsys: pytest.CaptureFixture[str]) -> None:
    shutil.rmtree(study.folder / "attention" / "01" / "lifted")
    assert "attention/01/lifted: an attention check of the study is gone" in complaint(capsys, "serve", study.run)


def test_a_study_of_which_a_placement_has_changed(study: ServedStudy, capsys: pytest.CaptureFixture[str]) -> None:
    """Votes on what was shown first and on what is there now are votes on two placements: refused, until the first is
    there again; so says a report, which counts the votes all the same."""
    design, name = read_design(study.folder), "bed-1"
    assert design is not None
    measured = sample_folder(study.run, name) / MEASURES
    measured.write_text('{"measures": 1}')
    design = replace(design, states=states_of(study.run, [name]))
    write_design(study.folder, design)
    assert changed_since(study.run, design.states) == ()
    measured.write_text('{"measures": 2}')
    said = complaint(capsys, "serve", study.run, "--port", free_port())
    assert f"1 placements have changed since its study began ({name})" in said
    item = study.session.current("r01")
    assert item is not None
    sent = {"item": item.item, "seconds": 1, **{axis.value: "left" for axis in AXES}}
    assert study.browser.post(f"{study.page('r01')}/votes", json=sent).status_code == 200
    assert report_study(str(study.run)).changed == (name,)
    measured.write_text('{"measures": 1}')
    assert report_study(str(study.run)).changed == ()


def test_a_broken_design_is_named(study: ServedStudy, capsys: pytest.CaptureFixture[str]) -> None:
    (study.folder / "study.json").write_text('{"version": 2}')
    assert "study.json: not a study's design" in complaint(capsys, "serve", study.run)


def test_a_report_without_votes(study: ServedStudy, capsys: pytest.CaptureFixture[str]) -> None:
    assert "its study has no votes yet; dcap study serve" in complaint(capsys, "report", study.run)
    assert not (study.run / "tables").exists()


def test_a_report_holds_the_votes(study: ServedStudy, capsys: pytest.CaptureFixture[str]) -> None:
    """r01 prefers dcap, then fireplace, and takes no floating copy; r02 presses left every time and is flagged.

    Each method is in 8 of a rater's 12 comparisons. Of r01's dcap wins 8, fireplace 4; which of r02's each wins
    follows from the sides, and the share is of both.
    """
    order = ["dcap", "fireplace", "layoutgpt"]
    left_of = dict.fromkeys(order, 0)
    for rater in ("r01", "r02"):
        while (item := study.session.current(rater)) is not None:
            better = "left" if order.index(item.left) < order.index(item.right) else "right"
            side = item.expected or better if rater == "r01" else "left"
            if rater == "r02" and item.lifted is None:
                left_of[item.left] += 1
            sent = {"item": item.item, "seconds": 1, **{axis.value: side for axis in AXES}}
            assert study.browser.post(f"{study.page(rater)}/votes", json=sent).status_code == 200
    assert main(["study", "report", str(study.run)]) == 0
    said = capsys.readouterr()
    floating_left = sum(one.lifted == "left" for one in study.session.design.raters["r02"])
    assert floating_left > 0
    assert said.err == f"dcap: r02 failed {floating_left} of 2 attention checks; the votes are included\n"
    rows = {row["method"]: row for row in csv.DictReader((study.run / "tables" / "table2.csv").open())}
    for number, method in enumerate(order):
        share = (8 - 4 * number + left_of[method]) / 16
        assert float(rows[method]["overall_wins"]) == pytest.approx(share, abs=1e-4)
        assert rows[method]["comparisons"] == "16"
    assert rows["dcap"]["raters_flagged"] == "1"
    assert "DCAP & " in (study.run / "tables" / "table2.tex").read_text()
    raters = list(csv.DictReader((study.folder / "raters.csv").open()))
    assert [row["flagged"] for row in raters] == ["False", "True"]
    assert raters[1]["left_share"] == "1.0"
    votes = pq.read_table(study.folder / "votes.parquet").to_pylist()
    assert len(votes) == 2 * 14 * 2
    assert sum(vote["attention_check"] for vote in votes) == 2 * 2 * 2
    first = (study.run / "tables" / "table2.csv").read_bytes()
    assert main(["study", "report", str(study.run)]) == 0
    assert (study.run / "tables" / "table2.csv").read_bytes() == first


def test_a_report_counts_what_was_refused(study: ServedStudy, capsys: pytest.CaptureFixture[str]) -> None:
    """Beside the votes, as Table 1 has it: also a method that placed nothing; not what is meant to be impossible."""
    for sample in SAMPLES:
        change_row(study.run, "layoutgpt", sample, verdict="infeasible", reason="no_region")
    change_row(study.run, "layoutgpt", "bed-1", feasible_intended=False)
    change_row(study.run, "fireplace", "bed-2", verdict="failed", error="it broke")
    while (item := study.session.current("r01")) is not None:
        body = {"item": item.item, "seconds": 1, **{axis.value: "left" for axis in AXES}}
        if "layoutgpt" in (item.left, item.right):
            study.session.answer("r01", item, dict.fromkeys(AXES, Side.LEFT), 1.0)
        else:
            study.browser.post(f"{study.page('r01')}/votes", json=body)
    assert main(["study", "report", str(study.run)]) == 0
    said = capsys.readouterr().out
    assert "No placement where one was intended: FirePlace* (offline rules) 1, LayoutGPT (offline rules) 3." in said
    assert "No comparison was answered by two raters" in said
    rows = {row["method"]: row for row in csv.DictReader((study.run / "tables" / "table2.csv").open())}
    assert {name: row["without_placement"] for name, row in rows.items()} == {
        "dcap": "0", "fireplace": "1", "layoutgpt": "3",
    }  # fmt: skip
    assert "LayoutGPT (offline rules) 3." in (study.run / "tables" / "table2.tex").read_text()


def test_a_study_grows_by_raters(study: ServedStudy) -> None:
    """More links later: those who were there keep theirs, and what they are asked."""
    design = read_design(study.folder)
    assert design is not None
    more = design.with_raters(5)
    write_design(study.folder, more)
    tokens = tokens_for(study.folder, list(more.raters))
    assert {name: tokens[name] for name in study.tokens} == study.tokens
    assert len(set(tokens.values())) == 5
    assert min(len(token) for token in tokens.values()) >= 32


def test_the_design_says_what_is_left_out(run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A person is told before anybody votes."""
    change_row(run, "fireplace", "bed-1", verdict="infeasible", reason="no_region")
    monkeypatch.setattr(serve, "make_checks", lambda *_: ())
    said: list[str] = []
    design = serve.new_design(read_study_run(run, read_rows(run)), run / STUDY_FOLDER, StudyOptions(), said.append)
    assert said[0] == "fireplace bed-1 is left out: no placement: no_region"
    assert said[-1].startswith("no attention checks")
    assert design.left_out == {"fireplace/bed-1": "no placement: no_region"}
    assert design.per_pair == 3


def test_links_name_a_host_that_others_reach() -> None:
    assert shown_host("127.0.0.1") == "127.0.0.1"
    assert shown_host("::1") == "[::1]"
    assert shown_host("0.0.0.0") == socket.gethostname()


@pytest.mark.parametrize(
    "url",
    [
        "study.example.org",
        "https://a.example/below",
        "ftp://a.example",
        "https://a.example?b",
        "https://a b.example",
        "https://:8090",
        "https://[::1",
        "https://a.example:port",
        "https://a.example:99999",
    ],
)
def test_an_address_that_is_none(run: Path, url: str, capsys: pytest.CaptureFixture[str]) -> None:
    """The option and what it takes are named."""
    assert f"--url {url}: give https://NAME" in complaint(capsys, "serve", run, "--url", url)


def test_links_begin_as_raters_reach_them(run: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """By the address of the web server that stands before the study."""
    links: list[str] = []
    monkeypatch.setattr(uvicorn.Server, "run", lambda *_, **__: None)
    options = StudyOptions(port=free_port(), url="https://study.example.org/")
    serve.serve_study(str(run), options, lambda _: None, lambda told: links.extend(told.values()))
    assert links
    assert all(link.startswith("https://study.example.org/s/") for link in links)
