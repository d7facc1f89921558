"""The samples of a scene by templates, and their sentences, drawn evenly and without repetition.

In: a scene's instances and objects. Out: sentences with their requests. Every draw is a digest of the seed, the scene's
name and the drawn item, so that no scene depends on another or on an order.

English sentences for placements, from templates: plain, one clause, with nouns from the scene.

In: a `PlacementAsk`. Out: a sentence. The given words seed the draw among several wordings.
"""

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from dcap.evaluation.sampling.requests import PlacedAsset, PlacementAsk, chance, feasible_asks, picked, refused_asks
from dcap.evaluation.sampling.supports import carrying_surfaces
from dcap.knowledge.lexicon import label_words
from dcap.language.protocol.requests import InstanceView
from dcap.scene.errors import InputError

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
TOO_LARGE_SHARE = 0.5
"""Share of infeasible samples without room; the others request a missing support [-]."""


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


@dataclass(frozen=True, slots=True)
class TemplateSample:
    """A sentence with its request."""

    ask: PlacementAsk
    prompt: str


def template_samples(
    scene: str, instances: Sequence[InstanceView], assets: Sequence[PlacedAsset], count: int, infeasible: int, seed: int
) -> list[TemplateSample]:
    """`count` samples of a scene, at most `infeasible` of which should be refused; InputError if it has too few."""
    surfaces = carrying_surfaces(instances)
    draw = AskDraw(scene, seed)
    refused = list(refused_asks(surfaces, assets, instances))
    kinds = [[ask for ask in refused if (ask.surface is None) == absent] for absent in (True, False)]
    for number in range(min(infeasible, count)):  # half of each kind, or more of one if the other runs out
        first = int(chance(seed, scene, number, "kind") < TOO_LARGE_SHARE)
        before = len(draw.made)
        draw.take(kinds[first], 1)
        draw.take(kinds[1 - first], before + 1 - len(draw.made))
    draw.take(feasible_asks(surfaces, assets, instances), count - len(draw.made))
    if len(draw.made) < count:
        what = "nothing that can be named carries anything" if not surfaces else f"has {len(draw.made)} samples"
        raise InputError(f"{scene}: {what}, fewer than {count}; lower --per-scene or add objects")
    return sorted(draw.made, key=lambda one: chance(seed, scene, one.ask.key, "order"))


class AskDraw:
    """Draws requests of one scene, preferring those that were drawn least."""

    def __init__(self, scene: str, seed: int) -> None:
        self.scene, self.seed = scene, seed
        self.made: list[TemplateSample] = []
        self.used: Counter[tuple[str, str]] = Counter()
        self.said: set[tuple[str, str]] = set()
        self.keys: set[str] = set()

    def take(self, asks: Iterable[PlacementAsk], count: int) -> None:
        """Draw `count` requests, or as many as there are."""
        left = {ask.key: ask for ask in asks if ask.key not in self.keys}
        order = sorted(left, key=lambda key: chance(self.seed, self.scene, key))
        for _ in range(count):
            while order:
                key = min(order, key=lambda one: self.times_used(left[one]))  # ties are broken by the drawn order
                order.remove(key)
                if self.add(left[key]):
                    break

    def times_used(self, ask: PlacementAsk) -> tuple[int, int, int]:
        """Number of draws of its support, its object, and its place with the pose."""
        return tuple(self.used[one] for one in spoken_of(ask))  # type: ignore[return-value]

    def add(self, ask: PlacementAsk) -> bool:
        """Keep a request with its sentence, unless the sentence exists."""
        prompt = sentence(ask, self.seed, self.scene)
        if (ask.asset.name, prompt) in self.said:
            return False
        self.said.add((ask.asset.name, prompt))
        self.keys.add(ask.key)
        self.used.update(spoken_of(ask))
        self.made.append(TemplateSample(ask, prompt))
        return True


def spoken_of(ask: PlacementAsk) -> tuple[tuple[str, str], ...]:
    """Support, object, and place with the pose."""
    support = ask.surface.base.id if ask.surface is not None else ask.absent
    place = f"{ask.place} {ask.pose}" if ask.faced is None else f"{ask.place} facing"
    return ("support", support), ("object", ask.asset.name), ("place", place)
