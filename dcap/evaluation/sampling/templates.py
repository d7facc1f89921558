"""The samples of a scene by templates: drawn without repetition, supports in turn, objects and places evenly.

In: a scene's instances and objects. Out: sentences with their requests. Every draw is a digest of the seed, the scene's
name and the drawn item, so that no scene depends on another or on an order.
"""

from collections import Counter
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from dcap.evaluation.sampling.chance import chance
from dcap.evaluation.sampling.requests import PlacedAsset, PlacementAsk, feasible_asks, refused_asks
from dcap.evaluation.sampling.supports import carrying_surfaces
from dcap.evaluation.sampling.wording import sentence
from dcap.language.protocol.requests import InstanceView
from dcap.scene.errors import InputError

TOO_LARGE_SHARE = 0.5
"""Share of infeasible samples without room; the others request a missing support [-]."""


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
