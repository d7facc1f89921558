"""Whole flows in a test, without Prefect and without processes."""

from typing import Any

import pytest

from tasks.cache import Stage


def run_directly(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """Let every stage run where it is called; the names of those that are computed come to stand in the list."""
    ran: list[str] = []
    run = Stage.run

    def noted(stage: Stage[..., Any], *args: Any) -> Any:
        ran.append(stage.name)
        return run(stage, *args)

    monkeypatch.setattr(Stage, "run", noted)
    monkeypatch.setattr(Stage, "_needs_process", lambda *_: False)
    return ran
