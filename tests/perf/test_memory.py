"""What a long list of cached samples takes of memory is told from what was seen of the program."""

import pytest
from rich.console import Console

from perf.memory import Observation, memory_table, repeated, slope

MEGABYTE = 1_000_000
SAMPLES = 8
START, EACH, REPORT = 400 * MEGABYTE, 10 * MEGABYTE, 90 * MEGABYTE


def seen() -> list[Observation]:
    """A program that plans, takes as much with each sample as with any other, and then draws its report."""
    planning = [Observation(0, 100 * MEGABYTE), Observation(0, 300 * MEGABYTE)]
    writing = [Observation(count, START + count * EACH) for count in range(1, SAMPLES + 1)]
    end = START + SAMPLES * EACH
    return [*planning, *writing, Observation(SAMPLES, end + REPORT), Observation(SAMPLES, end)]


def test_memory_is_told_when_planned_at_quarters_and_at_the_report() -> None:
    """400 MB and 10 a sample, of 8 samples: 410 with the first, 420 to 480 at the quarters, 90 more for the report."""
    console = Console(width=100, color_system=None)
    with console.capture() as capture:
        console.print(memory_table(seen(), SAMPLES))
    told = [int(line.split()[-1]) for line in capture.get().splitlines()[1:]]
    assert told == [410, 420, 440, 460, 480, 570]


def test_the_slope_is_that_of_what_is_written() -> None:
    """Neither planning nor the report is part of what a sample adds."""
    assert slope(seen()) == pytest.approx(EACH)


def test_a_list_is_repeated_under_new_ids() -> None:
    """As many samples as are asked for, no id twice, all else as it was."""
    rows = repeated([{"id": "a", "scene": "1"}, {"id": "b", "scene": "2"}], 5)
    assert [row["scene"] for row in rows] == ["1", "2", "1", "2", "1"]
    assert len({row["id"] for row in rows}) == 5
