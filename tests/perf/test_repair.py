"""Every part that things are placed on can be closed."""

import os
from pathlib import Path

import pytest

from dcap.scene.types.scan import Method, RepairReport
from perf.repair import SAMPLES, SUPPORTS, PartRepair, room_rows, sample_rows, summaries

WHOLE_SCANS = ("hololens_", "polycam_", "quest_")
"""Rooms of the sample data that are one fused surface each."""


def assert_good(rows: list[PartRepair]) -> None:
    """Closed, sure of its inside, moved by less than the tolerance."""
    bad = [(r.place, r.thing, r.part, r.report.problem) for r in rows if not r.good]
    assert rows
    assert not bad
    assert all(r.report.closed and r.report.hausdorff <= r.report.tolerance for r in rows)


@pytest.mark.parametrize("name", ["hall_01", pytest.param("kids_01", marks=[pytest.mark.slow, pytest.mark.long])])
def test_every_support_of_an_embedded_room_is_closed(name: str) -> None:
    """What the segmentation finds in a room's files, each support by itself; all rooms: `python -m perf.repair`."""
    rows = list(room_rows(name))
    assert {r.part for r in rows} <= SUPPORTS
    assert_good(rows)


def test_missing_sample_data_are_told(monkeypatch: pytest.MonkeyPatch) -> None:
    """Without its folder the table says that a part of it is missing."""
    report = RepairReport(Method.CLOSED, True, 1.0, 0.0, 0.0, 5e-3, 2e-3, 0.1, 0.0, (), "")
    rows = [PartRepair("room", "bed", "mattress", True, report, 1.0)]
    monkeypatch.delenv(SAMPLES, raising=False)
    assert summaries(rows, [])[-1] == "sample data: not measured (DCAP_SAMPLE_DATA is not set)"
    monkeypatch.setenv(SAMPLES, "here")
    assert summaries(rows, rows)[-1].startswith("sample data: 1 of 1 closed")


@pytest.mark.third_party
@pytest.mark.slow
@pytest.mark.long
@pytest.mark.timeout(900)
@pytest.mark.skipif(not os.environ.get("DCAP_SAMPLE_DATA"), reason="needs $DCAP_SAMPLE_DATA")
def test_sample_meshes_are_closed() -> None:
    """Real objects and supports are closed and near; all but a draped bed keep the faces they came with.

    What is cut out of a scan of a whole room is one surface with its neighbours: closed, but not by its own faces."""
    rows = list(sample_rows(Path(os.environ["DCAP_SAMPLE_DATA"])))
    assert len(rows) >= 25
    assert all(r.report.closed for r in rows)
    pieces = [r for r in rows if not r.place.startswith(WHOLE_SCANS)]
    anew = {(r.place, r.part) for r in pieces if r.report.resolution > 0.0}
    assert anew <= {("myroom_mit/bed", "mattress")}
    assert_good([r for r in pieces if r.report.resolution == 0.0])
