"""What a flow run shows besides its states, as artifacts of Prefect; imports Prefect.

An artifact is for those who watch: where the server does not take it, the run's log says so and the run goes on.
"""

import html
import json
import re
from collections.abc import Mapping, Sequence
from uuid import UUID

from prefect.client.orchestration import get_client
from prefect.client.schemas.actions import ArtifactCreate, ArtifactUpdate
from prefect.logging import get_run_logger

from flows.lost_server import of_server

STEERING = re.compile(r"[\\`*\[\]()#+!|~]|(?<!\w)[_.\-]|[_.\-](?!\w)")
"""What steers a page of Markdown; within a word the last three do not."""


class RunArtifacts:
    """The artifacts of one flow run, each of which is written again and again under its name."""

    def __init__(self, run_id: UUID) -> None:
        self.run_id = run_id
        self.known: dict[str, UUID] = {}

    def put(self, key: str, kind: str, data: object, description: str = "") -> None:
        """Write an artifact: a progress (per cent), a table (rows as JSON) or a markdown (text)."""
        try:
            self._put(key, kind, data, description)
        except Exception as error:
            if not of_server(error):
                raise
            get_run_logger().warning("%s is not shown: %s", key, error)

    def _put(self, key: str, kind: str, data: object, description: str) -> None:
        with get_client(sync_client=True) as client:
            if key in self.known:
                client.update_artifact(self.known[key], ArtifactUpdate(data=data, description=description))
                return
            artifact = ArtifactCreate(key=key, type=kind, data=data, description=description, flow_run_id=self.run_id)
            self.known[key] = client.create_artifact(artifact).id


def table_data(rows: Sequence[Mapping[str, object]]) -> str:
    """Rows as Prefect's pages read them, which take each cell for a page of Markdown."""
    cells = [{key: plain_text(one) if isinstance(one, str) else one for key, one in row.items()} for row in rows]
    return json.dumps(cells, allow_nan=False)


def plain_text(text: str) -> str:
    """Text of others in a page of Markdown, shown as it is, addresses too."""
    return STEERING.sub(r"\\\g<0>", html.escape(text, quote=False)).replace("://", "&#58;//")
