"""Text from people and foreign files: how much is accepted, how it is shown, words of file names, misspellings.

Text that people and foreign files give: how much is taken, and how it is shown.

A sentence, a label or an id is bounded where it comes in, so that what carries it (names of runs, requests, pages) need
not be; control characters are refused in what a person types and made visible in what a file says.

Names of files, folders and nodes: their words for people, and which of them say nothing.

A name is made of words. Counters, levels of detail and the ids of data sets (hashes, UUIDs, article numbers) are none,
wherever they stand: no question, report or page calls a thing after one.
"""

import difflib
import re
import unicodedata
from collections.abc import Iterable, Sequence

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
TOOL_WORDS = """
cube sphere cylinder cone plane mesh object obj node group root scene geometry model material default solid body part
component primitive box polygon surface shape untitled world empty armature sketchfab gltf rootnode unnamed circle
icosphere torus none textured scan export output fbx dae blend glb
"""

GENERIC = frozenset(TOOL_WORDS.split())
"""Words that modelling tools put in by themselves."""

NOISE = re.compile(r"^(\d+k?|[a-z]|lod\d*|v\d+|\d+x\d+|low|high|res|resolution|poly|lowpoly|highpoly|final|copy|new)$")
"""Name pieces that carry no meaning: counters, letters, levels of detail."""

HEX = re.compile(
    r"(?<![0-9a-z])(?:[0-9a-f]{8}(?:[-_][0-9a-f]{4}){3}[-_][0-9a-f]{12}"
    r"|(?=[a-f]*\d)[0-9a-f]{16,}|(?=[0-9a-f]*\d[a-f])[0-9a-f]{8,})(?![0-9a-z])",
    re.I,
)
"""UUIDs, and hexadecimal digits that are too many, or too mixed, for a word and its number."""
RUN = re.compile(r"[A-Z]?[a-z]+|[A-Z]+|\d+")
"""Letters as in a word, capitals, or digits."""
SHORT_RUN = 2.4
"""Mean length of the runs of an id [characters]: of random ones two, of words with a number in them three and more."""
SHORT_WORD = 4
"""Letters in a row from which a piece with digits on both sides may be a word."""


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


def words_of(name: str) -> list[str]:
    """Lower-case words of a label, file or node name: 'BedDouble_A.001' -> ['bed', 'double']."""
    plain = HEX.sub(" ", unicodedata.normalize("NFKC", name))
    said = [piece for piece in re.split(r"[^\w]+|_+", plain) if not is_id(piece)]
    pieces = [low for piece in said for low in re.sub(r"(?<=[a-z])(?=[A-Z])", " ", piece).lower().split()]
    return [w for piece in pieces for w in [piece.rstrip("0123456789") or piece] if w and not NOISE.match(w)]


def is_id(piece: str) -> bool:
    """Whether letters and digits change so often that it is no word: 3f2a9c, B07XJ8C8F5; not mp3player."""
    runs = RUN.findall(piece)
    if len(runs) < 3 or not any(run.isdigit() for run in runs):
        return False
    letters = max((len(run) for run in runs if not run.isdigit()), default=0)
    return letters < SHORT_WORD or len(piece) < SHORT_RUN * len(runs)


def readable(name: str) -> str:
    """A name for people: its words, or, where nothing is left that is no id, the name itself; empty for an id alone."""
    rest = HEX.sub(" ", name).lower().replace("_", " ").split()
    return " ".join(words_of(name)) or " ".join(piece for piece in rest if not is_id(piece))


def says_something(name: str) -> bool:
    """Whether a name tells more than that there is a mesh."""
    return any(word not in GENERIC for word in words_of(name))


def did_you_mean(word: object, known: Iterable[str]) -> str:
    """The end of an error message that names the nearest known word; empty if none is near."""
    near = difflib.get_close_matches(str(word), list(known), 1)
    return f"; did you mean {near[0]!r}?" if near else ""


def first_of(words: Sequence[str], most: int) -> str:
    """The first of some words, and how many more there are."""
    more = len(words) - most
    return ", ".join(words[:most]) + (f" and {more} more" if more > 0 else "")


def not_one_of(word: object, known: Iterable[str]) -> str:
    """The end of an error message about a word of a closed list, after what was given."""
    words = list(known)
    return f"is not one of {', '.join(words)}{did_you_mean(word, words)}"
