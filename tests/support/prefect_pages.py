"""What a Prefect server tells of runs, as its own pages ask for it."""

import json
import time
from collections.abc import Callable
from contextlib import suppress
from typing import Any
from urllib.error import HTTPError
from urllib.request import Request, urlopen
from uuid import uuid4

Row = dict[str, Any]


class PrefectPages:
    """The answers of a server at `url`, which ends in /api."""

    def __init__(self, url: str) -> None:
        self.url = url
        self.headers = {"content-type": "application/json"}
        client = uuid4().hex
        with suppress(HTTPError):  # it asks for none
            with urlopen(f"{url}/csrf-token?client={client}", timeout=30) as answer:
                token = json.load(answer)["token"]
            self.headers |= {"Prefect-Csrf-Token": token, "Prefect-Csrf-Client": client}

    def post(self, path: str, **asked: object) -> Any:
        """The answer to a request with a body, as the rows of a filter."""
        request = Request(f"{self.url}{path}", json.dumps(asked).encode(), self.headers)
        with urlopen(request, timeout=30) as answer:
            return json.load(answer)

    def flow_runs(self, tag: str) -> list[Row]:
        """Flow runs with a tag, newest first."""
        tags = {"tags": {"all_": [tag]}}
        return list(self.post("/flow_runs/filter", flow_runs=tags, sort="START_TIME_DESC"))

    def task_runs(self, flow_run: object) -> dict[str, Row]:
        """Task runs of a flow run by their names."""
        rows: list[Row] = self.post("/task_runs/filter", flow_runs={"id": {"any_": [flow_run]}})
        return {row["name"]: row for row in rows}

    def artifacts(self, flow_run: object) -> dict[str, Row]:
        """Artifacts of a flow run by their keys."""
        rows: list[Row] = self.post("/artifacts/filter", flow_runs={"id": {"any_": [flow_run]}})
        return {row["key"]: row for row in rows}


def edges(task_runs: dict[str, Row]) -> set[tuple[str, str, str]]:
    """(name of a task, parameter, name of the task that made it) for each input that names a task run; what the task
    was called in is no input."""
    names = {row["id"]: name for name, row in task_runs.items()}
    return {
        (name, parameter, names[one["id"]])
        for name, row in task_runs.items()
        for parameter, made in row["task_inputs"].items()
        for one in made
        if parameter != "__parents__" and "id" in one
    }


def in_time(check: Callable[[], object], seconds: float = 60.0) -> None:
    """Wait for what a server records a little later."""
    deadline = time.monotonic() + seconds
    while True:
        try:
            check()
        except (AssertionError, KeyError, IndexError):
            if time.monotonic() > deadline:
                raise
            time.sleep(0.2)
        else:
            return
