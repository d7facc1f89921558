"""Votes that were acknowledged are on the disk, once each, whatever happens to the server."""

import os
from dataclasses import replace
from pathlib import Path

import pyarrow.parquet as pq
import pytest

from dcap.evaluation.statistics.comparisons import AXES
from dcap.evaluation.study.design import Side
from dcap.evaluation.study.study_folder import JOURNAL, StudyVote, VoteJournal, export_votes, read_votes
from dcap.scene.errors import InputError


def ballot(rater: str = "r01", item: str = "001", winner: Side = Side.LEFT) -> list[StudyVote]:
    """A rater's answers to one comparison."""
    return [StudyVote(rater, item, "bed", axis, "dcap", "layoutgpt", winner, None, 3.5) for axis in AXES]


def test_what_was_added_is_read_again(tmp_path: Path) -> None:
    with VoteJournal(tmp_path) as journal:
        assert journal.add(ballot())
        assert journal.answered("r01") == {"001"}
        assert journal.answered("r02") == frozenset()
        assert read_votes(tmp_path) == tuple(ballot())  # also while it is open
    with VoteJournal(tmp_path) as again:
        assert again.votes == tuple(ballot())


def test_no_vote_counts_twice(tmp_path: Path) -> None:
    """Sent again, the same or another answer changes nothing; a repeated line counts once."""
    with VoteJournal(tmp_path) as journal:
        journal.add(ballot())
        assert not journal.add(ballot())
        assert not journal.add(ballot(winner=Side.RIGHT))
        assert journal.votes == tuple(ballot())
    path = tmp_path / JOURNAL
    path.write_bytes(2 * path.read_bytes())
    assert read_votes(tmp_path) == tuple(ballot())


def test_what_is_answered_is_known_after_every_vote(tmp_path: Path) -> None:
    """Of comparisons from an earlier journal and of new ones; one without an answer to one question is not."""
    votes = [vote for number in range(3) for vote in ballot(item=f"{number:03d}")][:-1]
    (tmp_path / JOURNAL).write_bytes(b"".join(vote.line() for vote in votes))
    with VoteJournal(tmp_path) as journal:
        assert journal.answered("r01") == {"000", "001"}
        journal.add(ballot(item="007"))
        assert journal.answered("r01") == {"000", "001", "007"}
        assert journal.answered("r02") == set()


@pytest.mark.parametrize("cut", [1, 40, 150, 250])
def test_a_torn_end_is_cut_off_and_asked_again(tmp_path: Path, cut: int) -> None:
    """A comparison of which a line is missing counts as unanswered, and its new answer wins over what was left."""
    with VoteJournal(tmp_path) as journal:
        journal.add(ballot())
        journal.add(ballot(item="002"))
    path = tmp_path / JOURNAL
    path.write_bytes(path.read_bytes()[:-cut])
    assert set(ballot()) <= set(read_votes(tmp_path))
    with VoteJournal(tmp_path) as journal:
        assert journal.answered("r01") == {"001"}
        assert journal.add(ballot(item="002", winner=Side.RIGHT))
        assert journal.answered("r01") == {"001", "002"}
    assert path.read_bytes().endswith(b"\n")
    assert set(read_votes(tmp_path)) == {*ballot(), *ballot(item="002", winner=Side.RIGHT)}


def test_a_vote_that_cannot_be_kept_does_not_count(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A full disk: no part of it stays, and the journal takes the next one."""
    write = os.pwrite

    def full(file: int, data: bytes, place: int) -> int:
        return write(file, data[: len(data) // 2], place)

    with VoteJournal(tmp_path) as journal:
        journal.add(ballot())
        monkeypatch.setattr(os, "pwrite", full)
        with pytest.raises(OSError, match="bytes could be written"):
            journal.add(ballot(item="002"))
        assert read_votes(tmp_path) == journal.votes == tuple(ballot())
        monkeypatch.setattr(os, "pwrite", write)
        assert journal.add(ballot(item="002"))
    assert len(read_votes(tmp_path)) == 2 * len(AXES)


def test_every_vote_is_on_the_disk_before_it_is_acknowledged(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The file is synced after each comparison."""
    synced: list[int] = []
    sync = os.fsync
    with VoteJournal(tmp_path) as journal:
        monkeypatch.setattr(os, "fsync", lambda file: (synced.append(os.fstat(file).st_size), sync(file)))
        journal.add(ballot())
        assert synced == [(tmp_path / JOURNAL).stat().st_size]


def test_a_broken_line_is_named(tmp_path: Path) -> None:
    with VoteJournal(tmp_path) as journal:
        journal.add(ballot())
    path = tmp_path / JOURNAL
    lines = path.read_text().splitlines()
    path.write_text("\n".join([lines[0], lines[1].replace("left", "up")]) + "\n")
    for look in (read_votes, VoteJournal):
        with pytest.raises(InputError, match=r"votes\.jsonl: line 2 is no vote") as error:
            look(tmp_path)
        assert "\n" not in str(error.value)


def test_a_second_server_is_refused(tmp_path: Path) -> None:
    with VoteJournal(tmp_path), pytest.raises(InputError, match="served already"):
        VoteJournal(tmp_path)
    VoteJournal(tmp_path).__exit__()


def test_the_export_marks_attention_checks(tmp_path: Path) -> None:
    """A row per vote; the known answer of a check is the side that does not float."""
    check = replace(ballot()[1], right="dcap", lifted=Side.LEFT)
    rows = pq.read_table(export_votes(tmp_path, [ballot()[0], check])).to_pylist()
    assert [row["attention_check"] for row in rows] == [False, True]
    assert [row["expected"] for row in rows] == [None, "right"]
    assert rows[0]["axis"] == "right_place"
    assert rows[0]["winner"] == "left"
    assert pq.read_table(export_votes(tmp_path, [])).num_rows == 0
