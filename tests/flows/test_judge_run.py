"""`dcap judge` on a small run: what is asked, what is written, what counts, and what is refused in one line."""

import csv
import json
import re
import subprocess
import sys
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
from fake_api import FakeApi, data_of, error, message, question_of, says
from judged import REPLY, SCORES, placement
from many_methods_run import METHODS, SAMPLES, many_methods_run, method_folder, row, write_rows

from dcap.evaluation.judging.known_answers import KnownAnswer
from dcap.evaluation.judging.questions import EXAMPLES
from dcap.evaluation.judging.rubric import RUBRIC, SCALES
from dcap.evaluation.method_report import method_table
from dcap.evaluation.outcome_table import SampleOutcome
from dcap.evaluation.preference_report import write_comparison_table
from dcap.evaluation.statistics.comparisons import JudgedAxis, read_comparisons
from dcap.scene.types.pictures import PLACED
from flows.benchmark import finish, rewrite_page
from flows.cli.app import main
from flows.judge_run import read_rows

MODEL = "claude-sonnet-5-5"
METRICS = ("tables/metric_scores.csv", "tables/metric_scores.tex")
"""What the rubric makes."""
TABLE1 = ("tables/table1.csv", "tables/table1.tex")
"""What a model judged."""
OTHERS = (
    "tables/comparisons_by_method.csv", "tables/comparisons_by_method.tex",
    "judging/scores.parquet", "judging/comparisons.parquet", "results.parquet",
)  # fmt: skip


@pytest.fixture(autouse=True)
def quick_judging(monkeypatch: pytest.MonkeyPatch) -> None:
    """Few resamples and examples of one colour: neither intervals nor the examples' pictures are tested here."""
    monkeypatch.setattr("dcap.evaluation.judging.questions.drawn", lambda *_: np.zeros((8, 10, 3), dtype=np.uint8))
    monkeypatch.setattr("flows.judge_run.method_table", partial(method_table, resamples=50))
    monkeypatch.setattr("flows.judge_run.write_comparison_table", partial(write_comparison_table, resamples=50))


@pytest.fixture
def small(tmp_path: Path) -> Path:
    """Two methods on one sample: four questions."""
    prompts = {"bed-1": SAMPLES["bed-1"]}
    return many_methods_run(tmp_path / "small", METHODS[:2], chooser=MODEL, prompts=prompts)


@pytest.fixture
def run(tmp_path: Path) -> Path:
    """Three methods on four samples, with the pictures that a judge wants."""
    return many_methods_run(tmp_path / "run", chooser=MODEL)


def rows_of(run: Path) -> dict[str, dict[str, str]]:
    """The table of scores by method: there is one."""
    (path,) = [run / name for name in (METRICS[0], TABLE1[0]) if (run / name).exists()]
    return {one["method"]: one for one in csv.DictReader(path.open())}


def record_of(run: Path) -> dict[str, object]:
    """judge.json."""
    return json.loads((run / "judging" / "judge.json").read_text())


def contents(run: Path) -> dict[str, bytes]:
    """Files of a run that a judge makes."""
    names = [one for one in (*METRICS, *TABLE1, *OTHERS) if (run / one).exists()]
    return {name: (run / name).read_bytes() for name in names}


def complaint(capsys: pytest.CaptureFixture[str], *words: object) -> str:
    """What a command says where it ends with exit code 2, in one line."""
    assert main(["judge", *map(str, words)]) == 2
    said = capsys.readouterr().err
    assert said.count("\n") == 1
    return said


def judging(body):
    """A model that scores by the prompt's length and takes the left one, but ties on the place."""
    if question_of(body) == "judge_pair":
        return message(json.dumps(REPLY | {"right_place": "tie"}))
    return message(json.dumps(SCORES | {"right_place": 5 + len(data_of(body)["prompt"]) % 5}))


def changed(run: Path, method: str, sample: str, **values: object) -> None:
    """Change a row of results.parquet."""
    rows = [
        replace(one, **values) if (one.method, one.sample) == (method, sample) else one  # type: ignore[arg-type]
        for one in read_rows(run)
    ]
    write_rows(run, rows)


def test_the_rubric_judges_a_run(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Offline, without pictures: scores, comparisons of all pairs in both orders, the columns, and the table."""
    for path in run.rglob("views/*.png"):
        path.unlink()
    assert main(["judge", str(run)]) == 0
    said = capsys.readouterr().out
    assert f"Judged by: {RUBRIC}; {12 + 4 * 3 * 2} questions." in said
    rows = rows_of(run)
    assert list(rows) == list(METHODS)
    assert {one["judge"] for one in rows.values()} == {RUBRIC}
    physics = [float(rows[name]["physics_naturalness"]) for name in METHODS]
    assert physics == sorted(physics, reverse=True)
    assert float(rows["layoutgpt"]["elo"]) == 1000.0
    assert rows["dcap"]["samples"] == "4"
    place = float(rows["dcap"]["right_place"])
    assert float(rows["dcap"]["composite"]) == pytest.approx((place * physics[0]) ** 0.5, abs=1e-3)
    assert len(read_comparisons(run / "judging" / "comparisons.parquet")) == 4 * 3 * 2 * 3
    found = read_rows(run)
    assert {one.judge for one in found} == {RUBRIC}
    assert {one.physics_naturalness for one in found if one.method == "dcap"} == {physics[0]}
    assert record_of(run)["same_family"] is False


def test_what_the_rubric_makes_is_never_table_1(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Files, page and lines say Metrics, and how many of its scores have the referee's drift: here one of twelve."""
    changed(run, "dcap", "bed-1", referee_drift_m=1e-5, referee_drift_deg=0.01)
    assert main(["judge", str(run)]) == 0
    said = capsys.readouterr().out
    texts = [said, *((run / path).read_text() for path in METRICS), (run / "report.html").read_text()]
    assert not any("table 1" in one.lower() or "table1" in one for one in texts)
    assert all("Metrics: scores by stated rules" in one for one in (said, texts[2], texts[3]))
    assert {one["with_referee"] for one in rows_of(run).values()} == {"1 of 12"}
    assert "11 of 12 scores of P & N were made without the independent referee's drift" in said
    assert not any((run / path).exists() for path in TABLE1)


def test_names_say_who_answered_for_baselines(tmp_path: Path, run: Path) -> None:
    """Offline rules stand in for a model only where no model was asked."""
    assert main(["judge", str(run)]) == 0
    assert rows_of(run)["fireplace"]["name"] == "FirePlace*"
    offline = many_methods_run(tmp_path / "offline")
    assert main(["judge", str(offline)]) == 0
    assert rows_of(offline)["fireplace"]["name"] == "FirePlace* (offline rules)"
    assert "FirePlace* (offline rules) & $" in (offline / METRICS[1]).read_text()
    assert rows_of(offline)["dcap"]["name"] == "DCAP"


def test_a_model_judges_by_pictures(small: Path, api: FakeApi) -> None:
    """Two views of a placement and two of before, and the examples where it scores; no method is named; habits and cost
    are kept; the maker is told."""
    api.answers = [judging]
    assert main(["judge", str(small), "--language", "anthropic", "--model", MODEL]) == 0
    assert len(api.asked) == 2 + 2
    pictures = {sum(block["type"] == "image" for block in one["messages"][0]["content"]) for one in api.asked}
    assert pictures == {2 * len(EXAMPLES) + 2 + len(PLACED), 2 + 2 * len(PLACED)}
    words = json.dumps([data_of(one) for one in api.asked])
    assert not any(name in words for name in (*METHODS, "penetration", "gap_m"))
    record = record_of(small)
    assert (record["judge"], record["chooser"], record["same_family"]) == (MODEL, MODEL, True)
    assert (record["questions"], record["judged"], record["lowest"], record["left_out"]) == (4, 2, 0, 0)
    sides = record["sides"]
    assert sides["right_place"]["tie_rate"] == 1.0  # type: ignore[index]
    assert (sides["overall"]["left_share"], sides["overall"]["consistent"]) == (1.0, 0)  # type: ignore[index]
    assert record["language"]["asked"] == 4  # type: ignore[index]
    assert rows_of(small)["dcap"]["same_family"] == "True"
    assert f"same maker as {MODEL}" in (small / "tables" / "table1.tex").read_text()
    assert {one.judge for one in read_rows(small)} == {MODEL}


def test_what_changes_after_it_was_judged_is_told(small: Path, api: FakeApi) -> None:
    """The page is written with the judgement; a placement made anew keeps its score, and the table says so."""
    api.answers = [judging]
    assert main(["judge", str(small), "--language", "anthropic", "--model", MODEL]) == 0
    assert MODEL in (small / "report.html").read_text()
    assert "have changed" not in (small / "tables" / "table1.tex").read_text()
    (method_folder(small, "dcap", "bed-1") / "measures.json").write_text("{}")
    rewrite_page(small, read_rows(small))
    assert "1 placements have changed since they were judged (bed-1)" in (small / "tables" / "table1.tex").read_text()


def test_recorded_replies_give_the_same_tables(small: Path, api: FakeApi, tmp_path: Path) -> None:
    """Byte for byte, with nobody to ask; and a report that is written again keeps the model's scores."""
    api.answers = [judging]
    recording = ["--record", str(tmp_path / "recorded")]
    assert main(["judge", str(small), "--language", "anthropic", *recording]) == 0
    first, asked = contents(small), len(api.asked)
    assert main(["judge", str(small)]) == 0
    assert set(contents(small)) == {*METRICS, *OTHERS}
    assert main(["judge", str(small), "--replay", str(tmp_path / "recorded")]) == 0
    assert contents(small) == first
    assert len(api.asked) == asked
    fresh = [row(method, "bed-1", SAMPLES["bed-1"]) for method in METHODS[:2]]
    assert set(first) == {*TABLE1, *OTHERS}
    for path in TABLE1:
        (small / path).unlink()
    kept = finish(small, fresh, 1.0)
    assert contents(small) == first
    assert {one.judge for one in kept.rows} == {MODEL}


def test_a_benchmark_of_several_methods_ends_with_the_rubric(run: Path) -> None:
    """Its rows have scores, and the run has its table, the same as `dcap judge` makes."""
    rows = read_rows(run)
    ended = finish(run, rows, 1.0)
    assert ended.table is not None
    first = contents(run)
    assert main(["judge", str(run)]) == 0
    assert contents(run) == first


def test_a_benchmark_of_one_method_compares_nothing(tmp_path: Path) -> None:
    """Its rows stay as they are."""
    run = many_methods_run(tmp_path / "one", ("dcap",))
    rows = read_rows(run)
    ended = finish(run, rows, 1.0)
    assert (ended.rows, ended.table) == (rows, None)
    assert not (run / "judging").exists()
    assert not any((run / path).exists() for path in (*TABLE1, *METRICS))


def test_refusing_costs_and_is_not_compared(run: Path) -> None:
    """No placement where one was intended is 1 on both axes, for a failure too; what ought to be impossible, or of
    which nobody said, is left out."""
    changed(run, "fireplace", "bed-1", verdict="infeasible", reason="no_room")
    changed(run, "layoutgpt", "bed-2", verdict="failed", error="it broke")
    changed(run, "fireplace", "sofa/3", verdict="infeasible", reason="no_room", feasible_intended=None)
    for method in METHODS:
        changed(run, method, "desk-4", feasible_intended=False)
    assert main(["judge", str(run)]) == 0
    found = {(one.method, one.sample): one for one in read_rows(run)}
    for key in (("fireplace", "bed-1"), ("layoutgpt", "bed-2")):
        assert (found[key].right_place, found[key].physics_naturalness) == (1.0, 1.0)
    for key in (("fireplace", "sofa/3"), ("dcap", "desk-4")):
        assert (found[key].right_place, found[key].judge) == (None, "")
    assert sorted({(one.sample, *one.pair) for one in read_comparisons(run / "judging" / "comparisons.parquet")}) == [
        ("bed-1", "dcap", "layoutgpt"), ("bed-2", "dcap", "fireplace"), ("sofa/3", "dcap", "layoutgpt"),
    ]  # fmt: skip
    rows = rows_of(run)
    assert [rows[name]["samples"] for name in METHODS] == ["3", "2", "3"]
    assert [rows[name]["without_placement"] for name in METHODS] == ["0", "1", "1"]
    assert [rows[name]["left_out"] for name in METHODS] == ["1", "2", "1"]
    scores = pq.read_table(run / "judging" / "scores.parquet").to_pylist()
    assert [one["analysis"] for one in scores if one["right_place"] == 1.0] == [
        "no placement: no_room", "no placement: it broke",
    ]  # fmt: skip


def test_comparisons_come_to_win_rates_and_ratings(run: Path) -> None:
    """By method and axis; by hand: dcap wins all of its overall comparisons, layoutgpt none; the page has the table."""
    for sample in SAMPLES:
        changed(run, "layoutgpt", sample, referee_drift_m=0.3, gap_m=0.05)
    assert main(["judge", str(run)]) == 0
    rows = list(csv.DictReader((run / "tables" / "comparisons_by_method.csv").open()))
    assert [one["method"] for one in rows] == list(METHODS)
    assert [float(one["overall_wins"]) for one in rows] == [1.0, 0.5, 0.0]
    place = {one["method"]: float(one["right_place_wins"]) for one in rows}
    assert place == {"dcap": 1.0, "fireplace": 0.25, "layoutgpt": 0.25}  # these two tie
    # the four samples say the same: Wilson's interval of 4, 2 and 0 of 4, the first 4 / (4 + 1.96^2)
    assert {one["physics_naturalness_low"] for one in rows} == {"0.5101", "0.1500", "0.0000"}
    ratings = [float(one["bradley_terry"]) for one in rows]
    assert ratings == sorted(ratings, reverse=True)
    assert sum(ratings) == pytest.approx(3 * 1500.0, abs=0.2)
    assert {one["comparisons"] for one in rows} == {"16"}
    assert {one["judge"] for one in rows} == {RUBRIC}
    text = (run / "tables" / "comparisons_by_method.tex").read_text()
    assert f"Comparisons by {RUBRIC}: 24 overall" in text
    assert "a ridge keeps ratings finite" in text
    assert "DCAP & $100.0$ {\\small $[51.0, 100.0]$} & " in text
    assert "Comparisons by the judge" in (run / "report.html").read_text()


def test_physics_is_judged_where_nobody_stated_a_place(run: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The table has a dash for the place and the composite; scores have nulls; all in all physics decides."""
    place = dict.fromkeys(SCALES[JudgedAxis.RIGHT_PLACE])
    rows = [replace(one, feasible_intended=None, **place) for one in read_rows(run)]  # type: ignore[arg-type]
    ended = finish(run, rows, 1.0)
    assert ended.table is not None
    first = contents(run)
    assert main(["judge", str(run)]) == 0
    assert contents(run) == first
    assert f"{'DCAP':32s}{'-':>16s}" in capsys.readouterr().out
    found = rows_of(run)
    assert {(one["right_place"], one["composite"], one["samples"], one["left_out"]) for one in found.values()} == {
        ("", "", "4", "0")
    }
    assert (found["dcap"]["right_place_n"], found["dcap"]["physics_naturalness_n"]) == ("0", "4")
    physics = [float(found[name]["physics_naturalness"]) for name in METHODS]
    assert physics == sorted(physics, reverse=True)
    assert float(found["dcap"]["elo"]) > float(found["layoutgpt"]["elo"]) == 1000.0
    assert re.search(r"^DCAP & -- & \$.* & -- & \$.* & 0/4 ", (run / METRICS[1]).read_text(), re.MULTILINE)
    assert {one.right_place for one in read_rows(run)} == {None}
    assert {one.physics_naturalness for one in read_rows(run) if one.method == "dcap"} == {physics[0]}
    axes = {one.axis for one in read_comparisons(run / "judging" / "comparisons.parquet")}
    assert axes == {JudgedAxis.PHYSICS_NATURALNESS, JudgedAxis.OVERALL}


def test_a_place_that_one_sample_states_counts_there(run: Path) -> None:
    """The means are of the samples that each axis is known of, and the table says so."""
    place = dict.fromkeys(SCALES[JudgedAxis.RIGHT_PLACE])
    for method in METHODS:
        for sample in ("bed-1", "bed-2", "sofa/3"):
            changed(run, method, sample, **place)
    assert main(["judge", str(run)]) == 0
    found = rows_of(run)["dcap"]
    assert (found["right_place_n"], found["physics_naturalness_n"], found["samples"]) == ("1", "4", "4")
    means = float(found["right_place"]), float(found["physics_naturalness"])
    assert float(found["composite"]) == pytest.approx((means[0] * means[1]) ** 0.5, abs=1e-3)
    text = (run / METRICS[1]).read_text()
    assert "& 1/4 " in text
    assert "have a score on one axis only" in text


def test_a_method_without_any_score_has_dashes(run: Path) -> None:
    """It stays in the table."""
    for sample in SAMPLES:
        changed(run, "fireplace", sample, verdict="infeasible", feasible_intended=None)
    assert main(["judge", str(run)]) == 0
    assert (rows_of(run)["fireplace"]["composite"], rows_of(run)["fireplace"]["samples"]) == ("", "0")
    assert "FirePlace* & -- & -- & -- & -- & 0" in (run / METRICS[1]).read_text()


def test_what_cannot_be_judged_is_one_line(
    run: Path, tmp_path: Path, api: FakeApi, capsys: pytest.CaptureFixture[str]
) -> None:
    """An unknown run, none, one method, no views, no truth for the rubric, old results; and nothing is written."""
    assert "'nowhere' is not a run" in complaint(capsys, "nowhere")
    assert "name the run to judge" in complaint(capsys)
    one = many_methods_run(tmp_path / "one", ("dcap",))
    assert "the run has only dcap, and a judge compares methods" in complaint(capsys, one)
    bare = many_methods_run(tmp_path / "bare")
    (method_folder(bare, "fireplace", "bed-1") / "views" / "closeup.png").unlink()
    said = complaint(capsys, bare, "--language", "anthropic")
    assert "closeup.png" in said
    metrics = {name: None for axis in SCALES.values() for name in axis}
    write_rows(bare, [replace(row, **metrics) for row in read_rows(run)])  # type: ignore[arg-type]
    assert "can score (no metric of it is known); see the verdicts" in complaint(capsys, bare)
    assert "--batch is for --language anthropic, not offline" in complaint(capsys, run, "--batch")
    (bare / "results.parquet").write_bytes(b"none")
    assert "results.parquet: no results that can be judged" in complaint(capsys, bare)
    (bare / "results.parquet").unlink()
    assert "bare: the run did not finish, it has no results.parquet" in complaint(capsys, bare)
    assert not api.asked
    assert not any((folder / "judging").exists() for folder in (one, bare))


def test_a_score_of_eleven_is_refused(small: Path, api: FakeApi, capsys: pytest.CaptureFixture[str]) -> None:
    """In one line, after it was asked again; the run stays as it was."""
    api.answers = [says(SCORES | {"right_place": 11})]
    before = (small / "results.parquet").read_bytes()
    said = complaint(capsys, small, "--language", "anthropic")
    assert "invalid answers to 'judge_score', last: right_place: Input should be less than or equal to 10" in said
    assert (small / "results.parquet").read_bytes() == before
    assert not (small / "tables").exists()
    assert not (small / "judging" / "judge.json").exists()


def test_a_sample_of_which_pictures_are_gone_is_named(
    run: Path, api: FakeApi, capsys: pytest.CaptureFixture[str]
) -> None:
    """The file that is missing."""
    (method_folder(run, "layoutgpt", "bed-2") / "views" / "closeup.png").unlink()
    said = complaint(capsys, run, "--language", "anthropic")
    assert "methods/layoutgpt/samples/bed-2/views/closeup.png" in said


def test_rows_survive_their_file(run: Path) -> None:
    """Every column is read as it was written."""
    assert read_rows(run)[0] == row("dcap", "bed-1", SAMPLES["bed-1"])
    assert isinstance(read_rows(run)[0], SampleOutcome)


def test_a_judge_is_validated(
    run: Path, api: FakeApi, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Printed and written, for a run or without one: the rubric is right twice, who says left once."""
    pair = KnownAnswer(
        placement("s", "a", 1), placement("s", "b", 2, gap_m=0.05), JudgedAxis.PHYSICS_NATURALNESS, "floating"
    )
    monkeypatch.setattr("flows.judge_run.known_answers", lambda name: [pair])
    assert main(["judge", str(run), "--validate"]) == 0
    assert f"{RUBRIC}: 10 of 10 known answers right (100%" in capsys.readouterr().out
    tree = json.loads((run / "judging" / "validation.json").read_text())
    assert (tree["accuracy"], tree["by_flaw"], tree["client"]) == (1.0, {"floating": [10, 10]}, "offline")
    assert not (run / "tables").exists()
    api.answers = [says(REPLY)]
    assert main(["judge", "--validate", "--language", "anthropic"]) == 0
    said = capsys.readouterr().out.splitlines()
    assert "5 of 10 known answers right (50%" in said[0]
    tree = json.loads(Path(said[1]).read_text())
    assert (tree["accuracy"], tree["sides"]["left_share"], tree["sides"]["consistent"]) == (0.5, 1.0, 0)
    assert "'nowhere' is not a run" in complaint(capsys, "nowhere", "--validate")


def test_a_judge_that_cannot_be_asked_says_so_before_all_rooms_are_prepared(
    run: Path, api: FakeApi, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """One pair is asked first; here the key is refused."""
    prepared: list[str] = []

    def pairs_of(name: str) -> list[KnownAnswer]:
        prepared.append(name)
        one, two = placement("s", "a", 1), placement("s", "b", 2, gap_m=0.05)
        return [KnownAnswer(one, two, JudgedAxis.PHYSICS_NATURALNESS, "floating")]

    monkeypatch.setattr("flows.judge_run.known_answers", pairs_of)
    api.answers = [lambda body: error(401, "authentication_error", "no such key")]
    assert "no such key" in complaint(capsys, run, "--validate", "--language", "anthropic")
    assert len(prepared) == 1


def test_a_run_that_is_none_is_told_before_anything_is_loaded() -> None:
    """Of what computes nothing is imported for it."""
    program = (
        "import sys; from flows.cli.app import main; code = main(sys.argv[1:]); "
        "assert not {'taichi', 'open3d', 'prefect'} & set(sys.modules), 'loaded'; sys.exit(code)"
    )
    for words in (["judge", "norun"], ["report", "norun"], ["study", "serve", "norun"], ["study", "report", "norun"]):
        done = subprocess.run([sys.executable, "-c", program, *words], capture_output=True, text=True, check=False)
        assert (done.returncode, "'norun' is not a run" in done.stderr) == (2, True), done.stderr
