"""Whose the server of the runs is: one that this project has started, or a team's, which somebody else looks after.

Either stands in $PREFECT_API_URL while work runs, for this process and all that it starts.
"""

import os

from dcap.scene.secrets import redacted_url

API_URL = "PREFECT_API_URL"
"""Prefect's variable with the address of the server to ask."""
LOGIN = "PREFECT_API_AUTH_STRING"
"""Prefect's variable with `NAME:PASSWORD` of a program that asks."""
OWN_URL = "DCAP_OWN_SERVER"
"""Variable with the address of the server that this project has started."""


def team_server() -> str:
    """Address of a team's server, as it may be shown; empty where the server is our own or there is none."""
    url = os.environ.get(API_URL, "")
    return "" if url == os.environ.get(OWN_URL) else redacted_url(url)
