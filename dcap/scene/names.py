"""Names of files, folders and nodes: their words for people, and which of them say nothing.

A name is made of words. Counters, levels of detail and the ids of data sets (hashes, UUIDs, article numbers) are none,
wherever they stand: no question, report or page calls a thing after one.
"""

import re
import unicodedata

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
