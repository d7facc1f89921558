"""What a Prefect server tells of runs, as its own pages ask for it."""

import json
from typing import Any
from urllib.request import Request, urlopen


class PrefectPages:
    """The answers of a server at `url`, which ends in /api."""

    def __init__(self, url: str) -> None:
        self.url = url

    def post(self, path: str, **asked: object) -> list[dict[str, object]]:
        """Rows of a filter."""
        return list(self.asked(path, asked))

    def create(self, path: str, **asked: object) -> dict[str, object]:
        """What was made."""
        return dict(self.asked(path, asked))

    def asked(self, path: str, body: object) -> Any:
        """The answer to a request with a body."""
        request = Request(f"{self.url}{path}", json.dumps(body).encode(), {"content-type": "application/json"})
        with urlopen(request, timeout=30) as answer:
            return json.load(answer)

    def get(self, path: str) -> dict[str, object]:
        """One thing."""
        with urlopen(f"{self.url}{path}", timeout=30) as answer:
            return dict(json.load(answer))

    def delete(self, path: str) -> None:
        """Delete one thing."""
        with urlopen(Request(f"{self.url}{path}", method="DELETE"), timeout=30):
            pass

    def flow_runs(self, parent: str = "") -> list[dict[str, object]]:
        """Flow runs that are no children, newest first; or the children of one, by their names."""
        if parent:
            return sorted(
                self.post("/flow_runs/filter", flow_runs={"parent_flow_run_id": {"any_": [parent]}}),
                key=lambda run: str(run["name"]),
            )
        own = {"parent_task_run_id": {"is_null_": True}}
        return self.post("/flow_runs/filter", flow_runs=own, sort="START_TIME_DESC")

    def task_runs(self, flow_run: object) -> list[dict[str, object]]:
        """Task runs of a flow run, in their order."""
        return self.post("/task_runs/filter", flow_runs={"id": {"any_": [flow_run]}}, sort="EXPECTED_START_TIME_ASC")

    def artifacts(self, flow_run: object) -> dict[str, dict[str, object]]:
        """Artifacts of a flow run by their keys."""
        found = self.post("/artifacts/filter", flow_runs={"id": {"any_": [flow_run]}})
        return {str(one["key"]): one for one in found}


def edges(task_runs: list[dict[str, object]]) -> set[tuple[str, str, str]]:
    """(name of a task, parameter, name of the task that made it) for each input of task runs that has a predecessor."""
    names = {run["id"]: str(run["name"]).partition(" ")[0] for run in task_runs}
    found = set()
    for run in task_runs:
        inputs = run["task_inputs"]
        assert isinstance(inputs, dict)
        found |= {(names[run["id"]], name, names[one["id"]]) for name, made in inputs.items() for one in made}
    return found
