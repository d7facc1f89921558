"""English sentences for placements, from templates: plain, one clause, with nouns from the scene.

In: a `PlacementAsk`. Out: a sentence. The given words seed the draw among several wordings.
"""

from dcap.evaluation.sampling.chance import chance, picked
from dcap.evaluation.sampling.requests import PlacementAsk
from dcap.language.offline.lexicon import label_words

VERBS = ("Put", "Place", "Set", "Leave", "Please put", "Please place", "I want to put", "Could you place")
VERBS_OF_POSE = {
    "upright": ("Stand", "Put", "Place", "Set"),
    "upside_down": ("Put", "Place", "Set", "Please put"),
    "on_side": ("Lay", "Please lay", "Put", "Place"),
}
POSE_WORDS = {"upright": "upright", "upside_down": "upside down", "on_side": "on its side"}
PLACES = {
    "whole": ("on the {base}", "onto the {base}", "on top of the {base}"),
    "center": ("at the center of the {base}", "in the middle of the {base}", "at the centre of the {base}"),
    "half": ("on the {side} side of the {base}", "on the {side} half of the {base}"),
    "foot": ("near the foot of the {base}", "at the foot end of the {base}"),
    "edge": ("near the edge of the {base}", "close to the edge of the {base}", "at the edge of the {base}"),
    "side edge": ("near the {side} edge of the {base}", "close to the {side} edge of the {base}"),
    "corner": ("near a corner of the {base}", "at a corner of the {base}", "in a corner of the {base}"),
    "near": ("on the {base} near the {landmark}", "on the {base} close to the {landmark}"),
    "beside": ("on the {base} next to the {landmark}", "next to the {landmark} on the {base}",
               "on the {base} beside the {landmark}"),
    "absent": ("on the {absent}", "at the center of the {absent}", "near the edge of the {absent}"),
    "too large": ("on the {base}", "onto the {base}"),
}  # fmt: skip
FACING = (" facing the {faced}", ", facing the {faced}")
LOW = ("on the {base}", "onto the {base}")
"""Kinds for which "on top of" is wrong: a floor, a rug, a seat."""
ONTO, MOVING = "onto", ("put", "place")
"""Verbs that take "onto": a thing is put onto something, but not left or stood onto it."""
INDEFINITE = 0.15
"""Share of sentences that say "a ball" instead of "the ball" [-]."""
PLURAL = ("s", "ss")
"""Endings of plural nouns, and of singular ones that look like plurals."""


def sentence(ask: PlacementAsk, *words: object) -> str:
    """The request as a person would write it; `words` seed the draw of the wording."""
    place = picked(wordings(ask), *words, ask.key, "place")
    verbs: tuple[str, ...] = VERBS_OF_POSE.get(ask.pose, VERBS)
    if place.startswith(ONTO):
        verbs = tuple(one for one in verbs if one.lower().endswith(MOVING))
    verb = picked(verbs, *words, ask.key, "verb")
    where = place.format(
        base=picked(ask.surface.names, *words, ask.key, "base") if ask.surface is not None else "",
        side=ask.regions[0] if ask.regions else "",
        landmark=ask.landmark,
        absent=ask.absent,
    )
    if ask.faced is not None:
        where += picked(FACING, *words, ask.key, "facing").format(faced=" ".join(label_words(ask.faced.label)))
    indefinite = chance(*words, ask.key, "article") < INDEFINITE and not several(ask.asset.noun)
    article = with_article(ask.asset.noun) if indefinite else f"the {ask.asset.noun}"
    text = " ".join(part for part in (verb, article, POSE_WORDS.get(ask.pose, ""), where) if part)
    return f"{text}{'?' if verb.startswith('Could') else '.'}"


def wordings(ask: PlacementAsk) -> tuple[str, ...]:
    """Wordings of the place."""
    low = ask.surface is not None and ask.surface.is_kind("floor", "rug", "chair", "armchair", "sofa", "bench")
    return LOW if ask.place == "whole" and low else PLACES[ask.place]


def several(noun: str) -> bool:
    """Whether a noun looks like a plural: a plural takes no "a"."""
    return noun.endswith(PLURAL[0]) and not noun.endswith(PLURAL[1])


def with_article(noun: str) -> str:
    """ "a ball", "an apple"."""
    return f"{'an' if noun[0] in 'aeiou' else 'a'} {noun}"
