"""The table of starts."""

import pytest

from perf import starts
from tasks.runner.process_server import START_METHOD


@pytest.mark.slow
@pytest.mark.long
@pytest.mark.parametrize(("method", "columns"), [("spawn", 3), ("forkserver", 6)])
def test_starts_are_measured_as_they_are_made(method: str, columns: int, monkeypatch: pytest.MonkeyPatch) -> None:
    """The table shows forked starts where there is a server to fork them, and spawned ones everywhere."""
    monkeypatch.setenv(START_METHOD, method)
    monkeypatch.setattr(starts, "STAGES", ("render",))
    monkeypatch.setattr(starts, "REPEATS", 1)
    table = starts.table()
    cells = [next(iter(column.cells)) for column in table.columns]
    assert len(cells) == columns
    assert all(float(str(cell).split()[0]) > 0.0 for cell in cells[1:])
