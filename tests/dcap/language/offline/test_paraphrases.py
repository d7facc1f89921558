"""Many ways to ask for the same things: `paraphrases.txt` against the offline reader, in a room with two beds.

The first half of the file was written down before its author saw the grammar.
"""

import re
from collections.abc import Callable
from pathlib import Path

import pytest

from dcap.language.offline.client import OfflineClient
from dcap.language.protocol.questions import INTENT
from dcap.language.protocol.replies import Constraint
from dcap.language.protocol.requests import IntentRequest
from dcap.scene.errors import LanguageError

TABLE = Path(__file__).parents[1] / "paraphrases.txt"
KEYS = ("part", "which", "regions", "refs", "limits", "pose", "lean", "facing", "turn", "lost")


def sentences() -> list[str]:
    lines = TABLE.read_text(encoding="utf-8").splitlines()
    return [line for line in lines if line and not line.startswith("#")]


def expected(cell: str) -> dict[str, str]:
    """ "which=2 from top regions=left" as a dictionary with every key."""
    said = re.findall(rf"({'|'.join(KEYS)})=(.*?)(?= (?:{'|'.join(KEYS)})=|$)", cell)
    return {**dict.fromkeys(KEYS, ""), "pose": "any", "turn": "0", **dict(said)}


def limit_of(constraint: Constraint) -> str:
    """ "exactly left edge 0.2", "not_on part:pillow"."""
    metres = f"{constraint.metres:g}" if constraint.metres else ""
    return " ".join(word for word in (constraint.kind, *constraint.regions, constraint.reference, metres) if word)


def check_reading(line: str, ask: Callable[[str], IntentRequest]) -> None:
    """Fail unless a sentence is read as its line of the table says."""
    prompt, base, cell = (text.strip() for text in line.split("|"))
    if base == "!":
        with pytest.raises(LanguageError):
            OfflineClient().ask(INTENT, ask(prompt))
        return
    reply = OfflineClient().ask(INTENT, ask(prompt))
    assert reply.base_id == base.strip("?")
    assert bool(reply.missing) == (base == "?")
    if base != "?":
        assert expected(cell) == {
            "part": reply.part,
            "which": reply.which,
            "regions": ",".join(reply.regions),
            "refs": ",".join(reply.references),
            "limits": ",".join(limit_of(one) for one in reply.constraints),
            "pose": reply.pose,
            "lean": reply.lean_on,
            "facing": reply.facing,
            "turn": f"{reply.turn_deg:g}",
            "lost": ",".join(reply.not_understood),
        }


def test_paraphrases_are_read_as_a_person_reads_them(ask, subtests: pytest.Subtests):
    """Base, part, region, reference, pose, facing and the words that are not understood are those of the table."""
    for line in sentences():
        with subtests.test(line):
            check_reading(line, ask)
