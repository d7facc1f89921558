"""Judges: what they see, what they must not see, how strictly their answers are read, and that recordings replay."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from fake_api import FakeApi, data_of, message, question_of, reason_of, says
from judged import GOOD, REPLY, SCORES, flat, placement, three_methods
from PIL import Image

from dcap.evaluation.judging.judge import (
    comparisons,
    judge_name,
    model_family,
    pair_request,
    pictures_in,
    same_family,
    score_request,
    scores,
)
from dcap.evaluation.judging.questions import EXAMPLES, JUDGE_PAIR, JUDGE_SCORE
from dcap.evaluation.judging.rubric import RUBRIC
from dcap.evaluation.statistics.agreement import side_report
from dcap.evaluation.statistics.comparisons import JudgedAxis, Winner, pair_counts, write_comparisons
from dcap.evaluation.statistics.method_tables import win_rates
from dcap.language.connect import connect
from dcap.language.model import batch
from dcap.language.model.batch import batch_queue
from dcap.language.model.payload import payload_of
from dcap.language.offline.client import OfflineClient
from dcap.language.protocol.client import ClientName, LanguageConfig
from dcap.language.protocol.session import Session
from dcap.scene.errors import InputError, LanguageError

NAME = "claude-sonnet-5-5"
MODEL = LanguageConfig(client=ClientName.ANTHROPIC, model=NAME)
REPLAY = LanguageConfig(client=ClientName.REPLAY, model=NAME)


@pytest.fixture
def flat_examples(monkeypatch: pytest.MonkeyPatch) -> None:
    """Examples of one colour, where nobody looks at them: rendering them takes seconds."""
    monkeypatch.setattr("dcap.evaluation.judging.questions.drawn", lambda *_: np.zeros((8, 10, 3), dtype=np.uint8))


def pictures_of(body) -> int:
    return sum(block["type"] == "image" for block in body["messages"][0]["content"])


def judging(body):
    """A model that prefers the left one on each axis but the right place, and scores by the prompt's last digit."""
    if question_of(body) == "judge_pair":
        return message(json.dumps(REPLY | {"right_place": "tie"}))
    return message(json.dumps(SCORES | {"right_place": 5 + int(data_of(body)["prompt"][-1])}))


def test_the_rubric_judges_without_a_model():
    """Offline, each pair is compared twice, without a preference for a side; the settled one wins physics."""
    rows = comparisons(OfflineClient(), three_methods(), RUBRIC)
    assert len(rows) == 2 * 3 * 2 * 3  # samples, pairs, orders, axes
    report = side_report(rows)
    assert report.consistent == report.both_orders == 18
    assert report.left_share == 0.5
    physics = pair_counts([row for row in rows if row.axis is JudgedAxis.PHYSICS_NATURALNESS])
    assert {one.method: one.rate for one in win_rates(physics, resamples=10)}["dcap"] == 1.0
    place = {row.pair: row.winner for row in rows if row.axis is JudgedAxis.RIGHT_PLACE}
    assert place["dcap", "holodeck"] is Winner.TIE
    found = {(one.sample, one.method): one for one in scores(OfflineClient(), three_methods(), RUBRIC)}
    assert found["s0", "dcap"].physics_naturalness == 10.0
    assert "gap_m 0.01" in found["s0", "holodeck"].analysis
    assert found["s1", "layoutgpt"].judge == RUBRIC


def test_the_rubric_judges_each_axis_by_itself():
    """Without a stated place there is no Right Place, and all in all physics decides; what has other axes than its
    rival is compared on those that both have, and not all in all. Nothing known at all is one line."""
    nowhere = dict.fromkeys(("support_hit", "part_hit", "region_distance_m", "orientation_error_deg"))
    one, other = placement("s", "a", 1, **nowhere), placement("s", "b", 2, gap_m=0.02, **nowhere)
    found = scores(OfflineClient(), [one, other], RUBRIC)
    assert [(row.right_place, row.physics_naturalness == 10.0) for row in found] == [(None, True), (None, False)]
    assert found[0].analysis == "metric rubric; lowest: not known, penetration_m 2e-05 (10.0)"
    rows = comparisons(OfflineClient(), [one, other], RUBRIC)
    assert {(row.axis, row.winning_method) for row in rows} == {
        (JudgedAxis.PHYSICS_NATURALNESS, "a"), (JudgedAxis.OVERALL, "a"),
    }  # fmt: skip
    rows = comparisons(OfflineClient(), [one, placement("s", "b", 2)], RUBRIC)
    assert [(row.axis, row.winner) for row in rows] == [(JudgedAxis.PHYSICS_NATURALNESS, Winner.TIE)] * 2
    with pytest.raises(LanguageError, match="cannot judge a placement of which no metric is known"):
        scores(OfflineClient(), [placement("s", "a", 1, **dict.fromkeys(GOOD))], RUBRIC)


def test_a_model_sees_neither_methods_nor_metrics():
    """What is sent has the sentence, the pictures and what they show; methods and metrics are not in it."""
    one, other = three_methods(1)[:2]
    for payload, pictures in (
        (payload_of(JUDGE_SCORE, replace(score_request(one), examples=(flat("example", 5),))), 1 + 4),
        (payload_of(JUDGE_PAIR, pair_request(one, other)), 2 + 4),
    ):
        text = json.dumps(payload.readable())
        assert payload.pictures == pictures
        assert "put it on s0" in text
        assert "close-up of the contact" in text
        assert "The overview is from one camera for every placement" in text
        assert not any(word in text for word in ("dcap", "holodeck", "metrics", "penetration_m", "0.01"))


def test_a_pair_is_asked_in_both_orders_each_picture_by_its_name(api: FakeApi):
    """A then B, each with its views in one order; the second question has them exchanged."""
    api.answers = [judging]
    rows = comparisons(connect(MODEL, Session()), three_methods(1)[:2], NAME)
    assert [(row.left_method, row.right_method) for row in rows[::3]] == [("dcap", "holodeck"), ("holodeck", "dcap")]
    said = [[one["text"] for one in body["messages"][0]["content"] if one["type"] == "text"][:-1] for body in api.asked]
    assert said == [[
        "Picture 1: the scene before the object is placed", "Picture 2: the object alone",
        "Picture 3: placement A, overview", "Picture 4: placement A, close-up of the contact",
        "Picture 5: placement B, overview", "Picture 6: placement B, close-up of the contact",
    ]] * 2  # fmt: skip
    first, second = ([one for one in body["messages"][0]["content"] if one["type"] == "image"] for body in api.asked)
    assert first[2:4] == second[4:]
    assert first[4:] == second[2:4]
    # always the left one: never the same method in both orders, and a side is preferred
    decided = [row for row in rows if row.axis is JudgedAxis.OVERALL]
    assert side_report(decided).consistent == 0
    assert side_report(rows).tie_rate == pytest.approx(1 / 3)


@pytest.mark.parametrize(
    ("answer", "said"),
    [
        (SCORES | {"right_place": 11}, "right_place: Input should be less than or equal to 10"),
        (SCORES | {"physics_naturalness": 0.5}, "physics_naturalness: Input should be greater than or equal to 1"),
        (SCORES | {"right_place": None}, "right_place: .*null is no answer"),
        (SCORES | {"right_place": "8"}, "right_place: Input should be a valid number"),
        ({"analysis": "", "right_place": 8}, "physics_naturalness: Field required"),
        (SCORES | {"beauty": 3}, "beauty: Extra inputs are not permitted"),
        ("8 and 9", "not one JSON object"),
    ],
)
@pytest.mark.usefixtures("flat_examples")
def test_a_wrong_score_is_asked_again_and_then_refused(api: FakeApi, answer, said: str):
    """The model is told what is wrong, twice; then it is one line with the answer."""
    api.answers = [says(answer)]
    with pytest.raises(LanguageError, match=f"gave 3 invalid answers to 'judge_score', last: .*{said}") as error:
        scores(connect(MODEL, Session()), three_methods(1)[:1], NAME)
    assert "\n" not in str(error.value)
    assert len(api.asked) == 3
    assert re.search(said, reason_of(api.asked[-1]))


@pytest.mark.slow
def test_examples_come_with_their_pictures_and_scores():
    """Before all else, the same in every request, and kept for the next: they tell more than the placement itself. The
    first shows a ball in its dent, the third one that hovers, of another picture."""
    payload = payload_of(JUDGE_SCORE, score_request(three_methods(1)[0]))
    content = payload.messages[0]["content"]
    count = 2 * len(EXAMPLES)
    assert payload.pictures == count + 4
    said = [one["text"] for one in content if one["type"] == "text"][:count]
    assert said[0].startswith(
        'Picture 1: example 1, overview; "put the bowling ball at the center of the bed": it lies'
    )
    assert said[0].endswith("right_place 10, physics_naturalness 10")
    assert said[1] == "Picture 2: example 1, close-up of the contact"
    marked = [number for number, one in enumerate(content) if "cache_control" in one]
    assert marked == [2 * count - 1]
    again = payload_of(JUDGE_SCORE, score_request(three_methods(1)[1]))
    assert again.messages[0]["content"][: 2 * count] == content[: 2 * count]
    pictures = [one["source"]["data"] for one in content[: 2 * count] if one["type"] == "image"]
    assert len(set(pictures)) == count


@pytest.mark.parametrize(
    ("answer", "said"),
    [
        (REPLY | {"overall": None}, "overall: .*null is no answer"),
        (REPLY | {"overall": "both"}, "overall: Input should be 'A', 'B' or 'tie'"),
        ({name: value for name, value in REPLY.items() if name != "right_place"}, "right_place: Field required"),
    ],
)
def test_a_wrong_comparison_is_refused(api: FakeApi, answer, said: str):
    """A missing axis or an option that is none."""
    api.answers = [says(answer)]
    with pytest.raises(LanguageError, match=said):
        comparisons(connect(MODEL, Session()), three_methods(1)[:2], NAME)


@pytest.mark.usefixtures("flat_examples")
def test_a_mended_answer_counts(api: FakeApi):
    """A score of 11 is asked again with the reason; the second answer is taken."""
    api.answers = [says(SCORES | {"right_place": 11}), says(SCORES)]
    (found,) = scores(connect(MODEL, Session()), three_methods(1)[:1], NAME)
    assert (found.right_place, found.physics_naturalness) == (8.0, 6.5)


@pytest.mark.usefixtures("flat_examples")
def test_recorded_replies_give_the_same_tables_to_the_last_byte(api: FakeApi, tmp_path: Path):
    """Scores and comparisons from a recording are those of the model, with nobody to ask."""
    api.answers = [judging]
    client = connect(MODEL, Session(record=str(tmp_path / "r")))
    first = scores(client, three_methods(), judge_name(MODEL))
    write_comparisons(tmp_path / "a.parquet", comparisons(client, three_methods(), judge_name(MODEL)))
    asked = len(api.asked)
    assert asked == 6 + 12
    client = connect(REPLAY, Session(replay=str(tmp_path / "r"), kept=str(tmp_path / "none")))
    again = three_methods()[::-1]  # in whatever order placements come
    assert scores(client, again, judge_name(REPLAY)) == first
    write_comparisons(tmp_path / "b.parquet", comparisons(client, again, judge_name(REPLAY)))
    assert (tmp_path / "a.parquet").read_bytes() == (tmp_path / "b.parquet").read_bytes()
    assert len(api.asked) == asked


def test_a_batch_holds_all_pairs(api: FakeApi, monkeypatch: pytest.MonkeyPatch, tmp_path: Path):
    """All questions of a run wait together and go as one batch."""
    for name, seconds in (("QUIET_S", 0.3), ("POLL_S", 0.02), ("ASK_AGAIN_S", 0.1)):
        monkeypatch.setattr(batch, name, seconds)
    api.answers = [judging]
    session = Session(batch=str(tmp_path / "queue"))
    with batch_queue(tmp_path / "queue", session):
        rows = comparisons(connect(MODEL, session), three_methods(), NAME)
    assert len(rows) == 36
    assert [len(questions) for questions in api.batches.values()] == [12]


def test_judges_of_the_chooser_s_family_are_told():
    """The same maker, whatever version or gateway; a rubric is no model."""
    names = {
        "claude-opus-5-5": "anthropic", "maker/claude-sonnet-5-5": "anthropic", "us.maker.claude-3": "anthropic",
        "gpt-4o": "openai", "o3-mini": "openai", "qwen2.5-vl:7b": "alibaba", "Llama3.2-vision": "meta",
        "gemini-2.0-flash": "google", "Qwen/Qwen2.5-VL-7B": "alibaba", "deepseek-vl2": "deepseek", "x-ai/grok-4": "xai",
        "us.maker.deepseek.r1-v1:0": "deepseek", "OpenGVLab/InternVL3-78B": "opengvlab", "internvl3-8b": "opengvlab",
        "unheard-1": "unheard", "Gate/Owner/Unheard2.5vl:7b": "unheard", "eu.maker.unheard-v1:0": "unheard",
        "unheard_large": "unheard", "local/foo": "foo", "local/bar": "bar",
        "7b-of-mine": "7b-of-mine", "gate/maker/v2": "gate/maker/v2", "gate/": "gate/",
    }  # fmt: skip
    assert {name: model_family(name) for name in names} == names
    other = LanguageConfig(client=ClientName.ANTHROPIC, model="gpt-4o")
    assert same_family(MODEL, REPLAY)
    assert not same_family(other, MODEL)
    assert not same_family(*(other.model_copy(update={"model": f"local/{name}"}) for name in ("foo", "bar")))
    assert not same_family(LanguageConfig(), MODEL)
    assert (judge_name(LanguageConfig()), judge_name(REPLAY)) == (RUBRIC, NAME)
    assert judge_name(MODEL.model_copy(update={"endpoint": "gate"})) == f"{NAME}@gate"


def test_views_are_read_when_somebody_looks(tmp_path: Path):
    """Named files, in their order; one that is missing, or no view at all, is said before anything is asked."""
    for shade, name in enumerate(("front", "above")):
        Image.fromarray(np.full((4, 4, 3), 9 + shade, dtype=np.uint8)).save(tmp_path / f"{name}.png")
    found = pictures_in(tmp_path, ["above", "front"])
    assert [one.make()[0, 0, 0] for one in found] == [10, 9]
    with pytest.raises(InputError, match=r"left\.png: no such picture; a judge needs the run's views"):
        pictures_in(tmp_path, ["front", "left"])
    with pytest.raises(InputError, match="no view is named"):
        pictures_in(tmp_path, [])


def test_pairs_that_do_not_fit_are_refused():
    """Other views, the same placement twice."""
    one, other = three_methods(1)[:2]
    with pytest.raises(InputError, match="dcap and other have other views or prompts"):
        pair_request(one, placement("s1", "other", 3))
    with pytest.raises(InputError, match="is to be judged twice"):
        comparisons(OfflineClient(), [one, other, one], RUBRIC)
