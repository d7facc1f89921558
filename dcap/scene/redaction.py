"""URLs and messages without what is secret of them: user, password, token, query."""

from urllib.parse import unquote, urlsplit

SHORTEST_SECRET = 4
"""Letters of a secret that is looked for in messages; a shorter one would be found in every word."""


def redacted(url: str) -> str:
    """A URL without user, password, token and query, as it may be shown."""
    scheme, mark, rest = url.partition("://")
    rest, question, _ = rest.partition("?")
    place, slash, path = rest.partition("/")
    if "@" in place:
        place = f"***@{place.rpartition('@')[2]}"
    return f"{scheme}{mark}{place}{slash}{path}{question and '?***'}"


def without_secrets(text: str, url: str) -> str:
    """A message in which neither a URL nor what is secret of it is quoted."""
    parts = urlsplit(url)
    told = (parts.query, *parts.netloc.rpartition("@")[0].split(":", 1))
    secrets = {one for told_as in told for one in (told_as, unquote(told_as)) if len(one) >= SHORTEST_SECRET}
    text = text.replace(url, redacted(url))
    for secret in sorted(secrets, key=len, reverse=True):
        text = text.replace(secret, "***")
    return text
