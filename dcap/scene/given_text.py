"""Text that people and foreign files give: how much is taken, and how it is shown.

A sentence, a label or an id is bounded where it comes in, so that what carries it (names of runs, requests, pages) need
not be; control characters are refused in what a person types and made visible in what a file says.
"""

import re

LONGEST_PROMPT = 10_000
"""Characters of a sentence: some three pages, a hundred times the longest that people write."""
LONGEST_WORDS = 1000
"""Characters of a label, a name or another short option."""
LONGEST_NAME = 200
"""Characters of a name in a foreign file that are kept."""
LONGEST_ID = 1000
"""Characters of a sample's id; its folder has a shorter name."""
CONTROL = re.compile(r"[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f]")
"""What terminals obey and JSON or XML cannot hold, but for tabs and ends of lines."""
CONTROL_OR_END = re.compile(r"[\x00-\x1f\x7f-\x9f\u2028\u2029]")
"""The same with tabs and ends of lines, which names have not."""
STEERING = re.compile(r"[\x00-\x1f\x7f-\x9f\u2028\u2029\u202a-\u202e\u2066-\u2069\ud800-\udfff]")
"""What makes a terminal or a page show something else than the text, or what no UTF-8 file can hold."""


def unfit(text: str, most: int, *, lines: bool = False) -> str:
    """Why text that a person gave is not taken, to follow its name; empty if it is. A sentence may have `lines`."""
    if len(text) > most:
        return f"has {len(text)} characters, at most {most} are taken; say it shorter"
    found = (CONTROL if lines else CONTROL_OR_END).search(text)
    if found:
        return f"has the control character {found.group()!r} at place {found.start() + 1}; remove it"
    try:
        text.encode()
    except UnicodeEncodeError:
        return "is not valid UTF-8; check the terminal's encoding"
    return ""


def visible(text: str) -> str:
    """Text of a foreign file with what steers terminals, turns the direction of writing or is no character replaced."""
    return STEERING.sub("\ufffd", text)


def short_name(text: str) -> str:
    """A name or label of a foreign file: visible, and no longer than names are."""
    return visible(text[:LONGEST_NAME])


def shortened(text: str, most: int) -> str:
    """Text of at most so many characters; what is cut shows as an ellipsis."""
    return text if len(text) <= most else f"{text[: most - 1]}\u2026"
