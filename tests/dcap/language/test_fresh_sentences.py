"""Sentences as people type them, written before the reader was tried on them: none is silently wrong."""

from pathlib import Path
from typing import Any

import pytest
from sentence_table import Score, score

from flows.samples import load_yaml

TABLES = [Path(__file__).parent / name for name in ("fresh_sentences.yaml", "later_sentences.yaml")]
READ: list[Any] = [load_yaml(table) for table in TABLES if table.is_file()]
ROWS = [row for table in READ for row in table]
QUICK = ("hall_01", "bedroom_01")
"""Rooms of the quick tests; all of them take four minutes."""


def report(scores: list[tuple[Any, Score]]) -> str:
    return "\n".join(f"{row['room']}: {row['prompt']}: {', '.join(one.faults)} ({one.said})" for row, one in scores)


def test_supports_and_refusals_are_those_that_a_person_expects() -> None:
    """In two rooms, up to the intent: what carries the object, a question back, or a refusal, as written down."""
    scores = [(row, score(row, whole=False)) for row in ROWS if row["room"] in QUICK]
    wrong = [(row, one) for row, one in scores if one.faults]
    assert len(wrong) <= 0.1 * len(scores), report(wrong)


def check_places(rows: list[Any]) -> None:
    """Up to the anchor: at least 85 % as asked or honestly refused, none wrong without a word."""
    scores = [(row, score(row)) for row in rows]
    wrong = [(row, one) for row, one in scores if one.faults]
    assert not [one for _, one in wrong if one.silent], report(wrong)
    assert len(wrong) <= 0.15 * len(scores), report(wrong)


@pytest.mark.slow
def test_places_are_those_that_a_person_expects() -> None:
    """In one room."""
    check_places([row for row in ROWS if row["room"] == QUICK[0]])


@pytest.mark.slow
@pytest.mark.long
def test_places_are_those_that_a_person_expects_in_every_room() -> None:
    """In all of them."""
    check_places(ROWS)
