"""Secrets in printed or written text: keys of APIs, tokens, passwords within addresses; URLs without them.

Secrets in what is printed or written: keys of APIs, tokens, passwords within addresses.

An SDK's, a server's or a proxy's message may quote a header or an address. What is shown to people passes `redacted`.
"""

import os
import re
from urllib.parse import unquote, urlsplit

HIDDEN = "***"
SHORTEST = 8
"""Values of environment variables that are shorter are words of their own and hide nothing."""
NAMES = re.compile(r"(KEY|TOKEN|SECRET|PASSWORD|PASSWD|CREDENTIALS|CONNECTION_URL|AUTH_STRING)$")
"""Environment variables whose values are secrets."""
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
"""Schemes of addresses in which an @ means somebody; elsewhere a path may have one."""
SHORTEST_SECRET = 4
"""Letters of a secret that is looked for in messages; a shorter one would be found in every word."""


def redacted(text: str) -> str:
    """Text without the secrets that it quotes."""
    for name, value in os.environ.items():
        if len(value) >= SHORTEST and NAMES.search(name.upper()):
            text = text.replace(value, HIDDEN)
    for pattern, instead in PATTERNS:
        text = pattern.sub(instead, text)
    return text


def redacted_url(url: str) -> str:
    """A URL without user, password, token and query, as it may be shown."""
    scheme, log_in, place = parts_of(url)
    place, question, _ = place.partition("?")
    return f"{scheme}{log_in and '***@'}{place}{question and '?***'}"


def has_log_in(url: str) -> bool:
    """Whether a user, perhaps with a password, stands in an address."""
    return parts_of(url)[1] != ""


def parts_of(url: str) -> tuple[str, str, str]:
    """Scheme, who signs in (empty for nobody), and the rest of an address. A password may hold slashes, so all before
    the last @ belongs to it, but for a path in which no colon stands before one."""
    found = SCHEME.match(url)
    assert found is not None  # it matches anything
    scheme, rest = found[1] or "", found[2]
    log_in, _, place = rest.rpartition("@")
    if "/" in log_in and ":" not in log_in and not scheme.lower().startswith(SERVERS):
        return scheme, "", rest
    return scheme, log_in, place


def without_secrets(text: str, url: str) -> str:
    """A message in which neither a URL nor what is secret of it is quoted."""
    told = (urlsplit(url).query, *parts_of(url)[1].split(":", 1))
    secrets = {one for told_as in told for one in (told_as, unquote(told_as)) if len(one) >= SHORTEST_SECRET}
    text = text.replace(url, redacted_url(url))
    for secret in sorted(secrets, key=len, reverse=True):
        text = text.replace(secret, "***")
    return text
