"""Text from people and foreign files: limits, display, words of file names, misspellings.

A sentence, a label or an id is limited on input, so that its later uses (names of runs, requests, pages) need no limit;
control characters are refused in a person's input and made visible in a file's.

Names of files, folders and nodes: their words for people, and recognition of meaningless ones.

A name consists of words. Counters, levels of detail and ids of datasets (hashes, UUIDs, article numbers) are not words,
wherever they occur: no question, report or page names a thing after one.
"""

import difflib
import re
import unicodedata
from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

from dcap.scene.errors import short

if TYPE_CHECKING:
    from pydantic import ValidationError

LONGEST_PROMPT = 10_000
"""Maximum length of a sentence [characters]: some three pages, a hundred times the longest usual one."""
LONGEST_WORDS = 1000
"""Maximum length of a label, a name or another short option [characters]."""
LONGEST_NAME = 200
"""Maximum length of a name from a foreign file [characters]; the rest is cut."""
LONGEST_ID = 1000
"""Maximum length of a sample's id [characters]; its folder has a shorter name."""
CONTROL = re.compile(r"[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f]")
"""Control characters that affect terminals and that JSON or XML cannot contain, except for tabs and line ends."""
CONTROL_OR_END = re.compile(r"[\x00-\x1f\x7f-\x9f\u2028\u2029]")
"""The same with tabs and line ends, which names must not contain."""
STEERING = re.compile(r"[\x00-\x1f\x7f-\x9f\u2028\u2029\u202a-\u202e\u2066-\u2069\ud800-\udfff]")
"""Characters that make a terminal or a page show something other than the text, or that UTF-8 files cannot contain."""
TOOL_WORDS = """
cube sphere cylinder cone plane mesh object obj node group root scene geometry model material default solid body part
component primitive box polygon surface shape untitled world empty armature sketchfab gltf rootnode unnamed circle
icosphere torus none textured scan export output fbx dae blend glb
"""

GENERIC = frozenset(TOOL_WORDS.split())
"""Words inserted automatically by modelling tools."""

NOISE = re.compile(r"^(\d+k?|[a-z]|lod\d*|v\d+|\d+x\d+|low|high|res|resolution|poly|lowpoly|highpoly|final|copy|new)$")
"""Name pieces that carry no meaning: counters, letters, levels of detail."""

HEX = re.compile(
    r"(?<![0-9a-z])(?:[0-9a-f]{8}(?:[-_][0-9a-f]{4}){3}[-_][0-9a-f]{12}"
    r"|(?=[a-f]*\d)[0-9a-f]{16,}|(?=[0-9a-f]*\d[a-f])[0-9a-f]{8,})(?![0-9a-z])",
    re.I,
)
"""UUIDs, and hexadecimal digits that are too many, or too mixed, for a word with a number."""
RUN = re.compile(r"[A-Z]?[a-z]+|[A-Z]+|\d+")
"""A run of letters as in a word, of capitals, or of digits."""
SHORT_RUN = 2.4
"""Mean length of the runs of an id [characters]: two in random ids, three and more in words with a number."""
SHORT_WORD = 4
"""Number of consecutive letters from which a piece with digits on both sides may be a word."""

SEVERAL = frozenset(("two", "three", "four", "five", "six", "seven", "eight", "several", "many", "both", "and"))
"""Words of names that speak of more than one thing: "two_sofas", "table_and_chairs"."""


def unfit(text: str, most: int, *, lines: bool = False) -> str:
    """Reason why a person's text is not accepted, to follow its name; empty if it is. A sentence may have `lines`."""
    if len(text) > most:
        return f"has {len(text)} characters, at most {most} are allowed; shorten it"
    found = (CONTROL if lines else CONTROL_OR_END).search(text)
    if found:
        return f"has the control character {found.group()!r} at place {found.start() + 1}; remove it"
    try:
        text.encode()
    except UnicodeEncodeError:
        return "is not valid UTF-8; check the terminal's encoding"
    return ""


def first_mistake(error: "ValidationError") -> str:
    """The first mistake that pydantic found, in a line: its keys, the mistake, and the value."""
    first = error.errors(include_url=False)[0]
    place, what = ".".join(map(str, first["loc"])), first["msg"].removeprefix("Value error, ")
    if first["type"] not in ("missing", "json_invalid"):
        what += f" (got {short(first['input'])})"
    return f"{place}: {what}" if place else what


def visible(text: str) -> str:
    """A foreign file's text in which characters that control terminals or text direction, or are invalid, are
    replaced."""
    return STEERING.sub("\ufffd", text)


def short_name(text: str) -> str:
    """A name or label from a foreign file: visible, and no longer than LONGEST_NAME."""
    return visible(text[:LONGEST_NAME])


def shortened(text: str, most: int) -> str:
    """A text of at most `most` characters, shortened with an ellipsis."""
    return text if len(text) <= most else f"{text[: most - 1]}\u2026"


def words_of(name: str) -> list[str]:
    """Lower-case words of a label, file or node name: 'BedDouble_A.001' -> ['bed', 'double']."""
    plain = HEX.sub(" ", unicodedata.normalize("NFKC", name))
    said = [piece for piece in re.split(r"[^\w]+|_+", plain) if not is_id(piece)]
    pieces = [low for piece in said for low in re.sub(r"(?<=[a-z])(?=[A-Z])", " ", piece).lower().split()]
    return [w for piece in pieces for w in [piece.rstrip("0123456789") or piece] if w and not NOISE.match(w)]


def is_id(piece: str) -> bool:
    """Return whether letters and digits alternate too often for a word: 3f2a9c, B07XJ8C8F5; not mp3player."""
    runs = RUN.findall(piece)
    if len(runs) < 3 or not any(run.isdigit() for run in runs):
        return False
    letters = max((len(run) for run in runs if not run.isdigit()), default=0)
    return letters < SHORT_WORD or len(piece) < SHORT_RUN * len(runs)


def readable(name: str) -> str:
    """A name for people: its words, or the name itself if no words remain but it is not an id; empty for an id."""
    rest = HEX.sub(" ", name).lower().replace("_", " ").split()
    return " ".join(words_of(name)) or " ".join(piece for piece in rest if not is_id(piece))


def names_several(name: str) -> bool:
    """Whether a name speaks of more than one thing."""
    return not SEVERAL.isdisjoint(words_of(name))


def says_something(name: str) -> bool:
    """Return whether a name says more than that there is a mesh."""
    return any(word not in GENERIC for word in words_of(name))


def did_you_mean(word: object, known: Iterable[str]) -> str:
    """The end of an error message that suggests the nearest known word; empty if none is near."""
    near = difflib.get_close_matches(str(word), list(known), 1)
    return f"; did you mean {near[0]!r}?" if near else ""


def first_of(words: Sequence[str], most: int) -> str:
    """The first of some words, and the number of others."""
    more = len(words) - most
    return ", ".join(words[:most]) + (f" and {more} more" if more > 0 else "")


def not_one_of(word: object, known: Iterable[str]) -> str:
    """The end of an error message about a word that is not in a closed list."""
    words = list(known)
    return f"is not one of {', '.join(words)}{did_you_mean(word, words)}"
