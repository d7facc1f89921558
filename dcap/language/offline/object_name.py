"""Name of the object where a model is asked about it: by a person, by its file or folder, or by the sentence.

In: what is known of its name. Out: words, never the hash, id or number that a data set may have for a file name.
"""

from pathlib import Path

from dcap.language.offline.sentence import read
from dcap.scene.errors import LanguageError
from dcap.scene.names import readable
from dcap.scene.readers.scenes.sugar import describe

NAMELESS = "object"


def object_name(path: Path, prompt: str, given: str = "") -> str:
    """The name that was given, else what the file's or its folder's name says, else the sentence's noun: "ball"."""
    return readable(given) or readable(describe(path)) or noun_of_sentence(prompt) or NAMELESS


def noun_of_sentence(prompt: str) -> str:
    """Name that the sentence has for the placed thing; empty where it is a pronoun, or the sentence is not read."""
    try:
        theme = read(prompt).theme
    except LanguageError:
        return ""
    return "" if theme is None or theme.pronoun else theme.name
