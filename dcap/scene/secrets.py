"""Secrets in what is printed or written: keys of APIs, tokens, passwords within addresses.

An SDK's, a server's or a proxy's message may quote a header or an address. What is shown to people passes `redacted`.
"""

import os
import re

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


def redacted(text: str) -> str:
    """Text without the secrets that it quotes."""
    for name, value in os.environ.items():
        if len(value) >= SHORTEST and NAMES.search(name.upper()):
            text = text.replace(value, HIDDEN)
    for pattern, instead in PATTERNS:
        text = pattern.sub(instead, text)
    return text
