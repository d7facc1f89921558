"""Hides secrets in text and URLs: API keys, tokens, and passwords in addresses.

Messages of an SDK, a server or a proxy may quote a header or an address. Everything shown to people passes `redacted`.
"""

import os
import re
from urllib.parse import unquote, urlsplit

HIDDEN = "***"
SHORTEST = 8
"""Least length of a secret value of an environment variable; shorter values may be ordinary words and are not
hidden."""
NAMES = re.compile(r"(KEY|TOKEN|SECRET|PASSWORD|PASSWD|CREDENTIALS|CONNECTION_URL|AUTH_STRING)$")
"""Environment variables whose values are secret."""
PATTERNS = (
    (re.compile(r"(?<=://)(?:[^\s/@]+|[^\s/@:]+:[^\s@]+)@"), f"{HIDDEN}@"),  # user and password of an address
    (re.compile(r"\bsk-[A-Za-z0-9_-]{6,}"), f"sk-{HIDDEN}"),
    (re.compile(r"(?i)\b(bearer|basic)\s+[A-Za-z0-9._~+/=-]{6,}"), rf"\1 {HIDDEN}"),
    (
        re.compile(
            r"(?i)\b((?:x-)?api[-_]?key|access[-_]?token|auth[-_]?token|token|secret|password|signature)"
            r"(['\"]?\s*[=:]\s*['\"]?)[^\s'\"&,;]{6,}"
        ),
        rf"\1\2{HIDDEN}",
    ),
)
SCHEME = re.compile(r"([A-Za-z][A-Za-z0-9+.-]*:?/+)?(.*)", re.DOTALL)
"""A scheme, perhaps misspelt, and the rest."""
SERVERS = ("http:", "https:")
"""Schemes of addresses in which an @ separates a user; elsewhere a path may contain one."""
SHORTEST_SECRET = 4
"""Least length of a secret to search for in messages; a shorter one would match ordinary words."""


def redacted(text: str) -> str:
    """A text with its secrets replaced."""
    for name, value in os.environ.items():
        if len(value) >= SHORTEST and NAMES.search(name.upper()):
            text = text.replace(value, HIDDEN)
    for pattern, instead in PATTERNS:
        text = pattern.sub(instead, text)
    return text


def redacted_url(url: str) -> str:
    """A URL without user, password, token and query, so that it can be shown."""
    scheme, log_in, place = parts_of(url)
    place, question, _ = place.partition("?")
    return f"{scheme}{log_in and '***@'}{place}{question and '?***'}"


def has_log_in(url: str) -> bool:
    """Return whether an address contains a user, perhaps with a password."""
    return parts_of(url)[1] != ""


def parts_of(url: str) -> tuple[str, str, str]:
    """Scheme, user part (may be empty), and the rest of an address. A password may contain slashes, so the user part
    ends at the last @; a path without a colon before it has none."""
    found = SCHEME.match(url)
    assert found is not None  # the pattern matches anything
    scheme, rest = found[1] or "", found[2]
    log_in, _, place = rest.rpartition("@")
    if "/" in log_in and ":" not in log_in and not scheme.lower().startswith(SERVERS):
        return scheme, "", rest
    return scheme, log_in, place


def without_secrets(text: str, url: str) -> str:
    """A message with a URL and its secret parts removed."""
    told = (urlsplit(url).query, *parts_of(url)[1].split(":", 1))
    secrets = {one for told_as in told for one in (told_as, unquote(told_as)) if len(one) >= SHORTEST_SECRET}
    text = text.replace(url, redacted_url(url))
    for secret in sorted(secrets, key=len, reverse=True):
        text = text.replace(secret, "***")
    return text
