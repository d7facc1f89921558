"""A drop that breaks down is told from one that ends otherwise, and is repeated on larger cells."""

from pathlib import Path
from typing import Any

import pytest

from dcap.scene.types.outcome import Infeasible, Reason
from flows.repeats import COARSER, broke_down, coarsened
from tasks.artifact import Store
from tasks.particles.config import ParticlesConfig


@pytest.mark.parametrize(("reason", "again"), [(Reason.UNSTABLE_STEP, True), (Reason.LEFT_TARGET, False)])
def test_only_a_breakdown_is_repeated(monkeypatch: pytest.MonkeyPatch, tmp_path: Path, *, reason, again) -> None:
    monkeypatch.setenv("DCAP_DATA", str(tmp_path))
    ref: Any = Store.default().save(Infeasible(reason, "t = 0.1 s", None))
    assert broke_down(ref) is again


def test_cells_grow_and_nothing_else_changes() -> None:
    before = ParticlesConfig(cells_across=6.0)
    after = coarsened(before)
    assert after.coarser == COARSER > 1.0
    assert after.model_copy(update={"coarser": 1.0}) == before
