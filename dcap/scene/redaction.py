"""URLs and messages without what is secret of them: user, password, token, query."""

import re
from urllib.parse import unquote, urlsplit

LOG_IN = re.compile(r"^(?>([A-Za-z][A-Za-z0-9+.-]*:/+)?)([^/:]*:.*|[^/]*)@", re.DOTALL)
"""A scheme, which may be forgotten, and who signs in: a password may hold slashes, and an @ of a path says nothing."""
SHORTEST_SECRET = 4
"""Letters of a secret that is looked for in messages; a shorter one would be found in every word."""


def redacted_url(url: str) -> str:
    """A URL without user, password, token and query, as it may be shown."""
    place, question, _ = LOG_IN.sub(r"\1***@", url).partition("?")
    return f"{place}{question and '?***'}"


def has_log_in(url: str) -> bool:
    """Whether a user, perhaps with a password, stands in an address."""
    return LOG_IN.match(url) is not None


def without_secrets(text: str, url: str) -> str:
    """A message in which neither a URL nor what is secret of it is quoted."""
    found = LOG_IN.match(url)
    told = (urlsplit(url).query, *(found[2] if found else "").split(":", 1))
    secrets = {one for told_as in told for one in (told_as, unquote(told_as)) if len(one) >= SHORTEST_SECRET}
    text = text.replace(url, redacted_url(url))
    for secret in sorted(secrets, key=len, reverse=True):
        text = text.replace(secret, "***")
    return text
