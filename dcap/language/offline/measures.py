"""Lengths and angles in a sentence, in any notation, as a decimal number and a unit.

In: a sentence. Out: the same sentence with "2 1/2 inches", "1,5 cm", "a foot and a half" or 5' 6" rewritten as "2.5
inches", "1.5 cm", "1.5 feet" and "1.676 m". A range is rewritten as its middle, with a note. Everything else is
unchanged.
"""

import re
from collections.abc import Iterable
from functools import cache

from dcap.knowledge.lexicon import PHRASES, rows
from dcap.scene.types.outcome import Cause, Caution

VULGAR = {"½": "1/2", "¼": "1/4", "¾": "3/4", "⅓": "1/3", "⅔": "2/3", "⅛": "1/8", "⅜": "3/8", "⅝": "5/8", "⅞": "7/8"}
"""Fractions as single characters; Unicode's own normal form would turn "2½" into "21/2"."""
SHORT = {"in": "inch", "in.": "inch", **dict.fromkeys(('"', "''", "″", "”"), "inch"), **dict.fromkeys("'′’", "foot")}
"""Units with another meaning where no length is meant."""
AMBIGUOUS = frozenset({"foot", "feet"})
"""Units that are also parts of things: digits before them make a length, number words only before a direction."""
DIRECTION = re.compile(
    r"\s*,?\s*(?:away|from|off|of|to\s+the|left|right|in\s+front|in\s+from|inside|behind|above|below|clear|apart|inwards?)\b"
)
"""Words that follow a length."""
PARTS_OF_ONE = {"half": 0.5, "quarter": 0.25, "third": 1.0 / 3.0}
MULTIPLES_OF = {"halves": 0.5, "quarters": 0.25, "thirds": 1.0 / 3.0}
MULTIPLIER = 100.0
"""The number word that multiplies the one before it."""
THOUSANDS = re.compile(r"[1-9]\d{0,2}(?:,\d{3})+")


def plain_measures(text: str) -> tuple[str, tuple[str, ...]]:
    """The sentence with plain lengths and angles, and a sentence for each range that was replaced by its middle."""
    for sign, fraction in VULGAR.items():
        text = text.replace(sign, f" {fraction}")
    notes: list[str] = []

    def compound(found: re.Match[str]) -> str:
        total = sum(amount(one["number"]) * unit_in_metres(one["unit"]) for one in measure().finditer(found[0]))
        return f" {total:.6g} m "

    def single(found: re.Match[str]) -> str:
        if not is_measure(found):
            return found[0]
        unit = SHORT.get(found["unit"].casefold(), found["unit"].rstrip("."))
        value = amount(found["number"])
        if first := found["first"]:
            value *= unit_in_metres(first) / unit_in_metres(found["unit"])
        if upper := found["to"] or found["and"]:
            value = 0.5 * (value + amount(upper))
            middle = f"{found[0].strip()!r} is read as its middle, {value:.6g} {unit}"
            notes.append(Caution(Cause.ASSUMED, middle))
        elif found["half"] is not None:
            value += 0.5
        return f" {value:.6g} {unit} "

    return measure().sub(single, chain().sub(compound, text)), tuple(notes)


def is_measure(found: re.Match[str]) -> bool:
    """Return whether a number and a unit are meant as a measure: "2 in" may be two in something, "a meter" a thing."""
    unit, digits = found["unit"].casefold(), any(c.isdigit() for c in found["number"])
    surely = unit not in SHORT if digits else found["number"].casefold() not in ("a", "an") and unit not in AMBIGUOUS
    return surely or DIRECTION.match(found.string, found.end()) is not None


@cache
def units(kind: str) -> dict[str, float]:
    """The words for units of a kind (`length` or `unit`, which is one of angle) with their values [m or degrees]."""
    found = rows(PHRASES)
    return {word: float(row["value"]) for row in found if row["kind"] == kind for word in row["phrases"].split("|")}


def unit_in_metres(unit: str) -> float:
    """The value of a length's unit [m]."""
    plain = unit.casefold()
    return units("length")[SHORT.get(plain, plain.rstrip("."))]


@cache
def numerals() -> dict[str, float]:
    """The number words."""
    found = [row for row in rows(PHRASES) if row["kind"] == "numeral"]
    return {word: float(row["value"]) for row in found for word in row["phrases"].split("|")}


@cache
def number_pattern() -> str:
    """Pattern of digits with a point, a comma or a fraction; number words; a half or a quarter; "a" and "an"."""
    word = f"(?:{alternatives(numerals())})"
    part = f"(?:{alternatives(PARTS_OF_ONE)})"
    fraction = r"\d+\s*[/⁄]\s*\d+"
    return (
        rf"(?:(?:\d+[\s-]+(?:and\s+)?)?{fraction}|{THOUSANDS.pattern}(?!\d)(?:\.\d+)?|\d+(?:[.,]\d+)?|\.\d+"
        rf"|(?:an?\s+)?{part}\s+(?:of\s+)?an?|{word}\s+(?:{alternatives(MULTIPLES_OF)})\s+of\s+an?|{word}(?:[\s-]+(?:and[\s-]+)?{word})*(?:[\s-]+and[\s-]+a[\s-]+{part})?"
        r"|a\s+couple\s+of|an?)"
    )


@cache
def measure() -> re.Pattern[str]:
    """Pattern of a number, or two that bound a range, a unit, and "and a half"."""
    number = number_pattern()
    words = alternatives([*units("length"), *units("unit")])
    signs = alternatives([sign for sign in SHORT if not sign.isalpha()])
    return re.compile(
        rf"(?<![\w.,/-])(?P<between>between\s+)?(?P<number>{number})"
        rf"(?(between)(?:\s*(?P<first>{words}))?\s+and\s+(?P<and>{number})"
        rf"|(?:\s*(?:-|\N{{EN DASH}}|\bto\b|\bor\b)\s*(?P<to>{number}))?)"
        rf"[\s-]*(?P<unit>(?:{words}|in)\b\.?|{signs})(?P<half>\s+and\s+a\s+half\b)?",
        re.IGNORECASE,
    )


@cache
def chain() -> re.Pattern[str]:
    """Two lengths that add up: 5 ft 6 in, 1 m and 20 cm."""
    number = number_pattern()
    signs = alternatives([sign for sign in SHORT if not sign.isalpha()])
    unit = rf"(?:(?:{alternatives([*units('length'), 'in'])})\b\.?|{signs})"
    return re.compile(
        rf"(?<![\w.,/-])(?<!between\s){number}\s*{unit}\s*,?\s*(?:and\s+)?{number}\s*{unit}", re.IGNORECASE
    )


def alternatives(words: Iterable[str]) -> str:
    """One of the words, longer ones first, as a pattern."""
    return "|".join(r"\s+".join(map(re.escape, word.split())) for word in sorted(words, key=len, reverse=True))


def amount(text: str) -> float:
    """The value of a number in any notation: "2 1/2", "1,5", "1,500", "one and a half", "forty five", "half a"."""
    plain = text.casefold().strip()
    if found := re.fullmatch(r"(?:(\d+)[\s-]+(?:and\s+)?)?(\d+)\s*[/⁄]\s*(\d+)", plain):
        return float(found[1] or 0) + float(found[2]) / float(found[3])
    if found := re.fullmatch(rf"({THOUSANDS.pattern})(\.\d+)?", plain):
        return float(found[1].replace(",", "") + (found[2] or ""))
    if plain[0].isdigit() or plain[0] == ".":
        return float(plain.replace(",", "."))
    return spelled(re.split(r"[\s-]+", plain))


def spelled(words: list[str]) -> float:
    """The value of number words: "two hundred seventy" is 270, "one and a half" 1.5, "a quarter of an" 0.25."""
    total = 0.0
    for word in words:
        if word in MULTIPLES_OF:
            total *= MULTIPLES_OF[word]
        elif word in PARTS_OF_ONE:
            total += PARTS_OF_ONE[word]
        elif word in numerals():
            value = numerals()[word]
            total = total * value if value == MULTIPLIER and total > 0.0 else total + value
    return total or (2.0 if "couple" in words else 1.0)
