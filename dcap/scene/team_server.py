"""Owner of the server of the runs: this project, which has started it, or a team, which maintains it.

The address of either is in $PREFECT_API_URL during a run, for this process and all its children.
"""

import os

from dcap.scene.secrets import redacted_url

API_URL = "PREFECT_API_URL"
"""Prefect's variable with the address of the server."""
LOGIN = "PREFECT_API_AUTH_STRING"
"""Prefect's variable with `NAME:PASSWORD` for clients."""
OWN_URL = "DCAP_OWN_SERVER"
"""Variable with the address of the server started by this project."""


def team_server() -> str:
    """Address of a team's server, without secrets; empty if the server is our own or there is none."""
    url = os.environ.get(API_URL, "")
    return "" if url == os.environ.get(OWN_URL) else redacted_url(url)
