"""Samples of a scene hold of that scene, do not repeat, and depend on the seed and the scene alone."""

from dataclasses import replace

import pytest
from furnished_views import ROOM, part, thing

from dcap.evaluation.sampling.questions import (
    SampleDraft,
    SamplesReply,
    SamplesRequest,
    by_templates,
    check_sample,
    draft_of,
    misread,
)
from dcap.evaluation.sampling.requests import PlacedAsset, absent_things, asked_front, feasible_asks
from dcap.evaluation.sampling.supports import carrying_surfaces
from dcap.evaluation.sampling.templates import TemplateSample, sentence, with_article
from dcap.evaluation.supports_plot import supports_table
from dcap.language.protocol.requests import IntentRequest, ObjectView
from dcap.scene.errors import InputError
from flows.selection import shares_of, split_scenes

BALL = PlacedAsset("ball", "ball", "ball", (0.2, 0.2, 0.2))
MUG = PlacedAsset("mug", "mug", "mug", (0.08, 0.08, 0.1))
BOTTLE = PlacedAsset("bottle", "bottle", "bottle", (0.07, 0.07, 0.25))
WARDROBE = PlacedAsset("wardrobe", "wardrobe", "wardrobe", (1.2, 0.6, 2.0))
BEAR = PlacedAsset("bear", "teddy bear", "plush toy", (0.3, 0.25, 0.35), front=(0.0, -1.0))
ASSETS = (BALL, MUG, BOTTLE, WARDROBE, BEAR)


def asked(count: int = 20, infeasible: int = 4, seed: int = 0, scene: str = "room") -> SamplesRequest:
    return SamplesRequest(scene, ROOM, (0.0, 0.0, 0.0), ASSETS, count, infeasible, seed)


def draft(**changes: object) -> SampleDraft:
    given = {"object": "mug", "prompt": "Put the mug on the desk.", "base_id": "desk_0"}
    return SampleDraft.model_validate({**given, **changes})


def test_samples_pass_the_check_of_any_client() -> None:
    """As many as asked for, at most so many to be refused, no two alike, and all hold of the scene."""
    reply = by_templates(asked())
    reply.check(asked())
    assert sum(one.reason != "" for one in reply.samples) == 4
    assert len({(one.object, one.prompt) for one in reply.samples}) == 20


def test_the_seed_and_the_scene_decide() -> None:
    """The same request gives the same samples, objects in another order too; another seed or scene gives others."""
    first = by_templates(asked())
    turned = SamplesRequest("room", ROOM[::-1], (0.0, 0.0, 0.0), ASSETS[::-1], 20, 4, 0)
    assert by_templates(turned) == first
    assert by_templates(asked(seed=1)) != first
    assert by_templates(asked(scene="other")) != first


@pytest.mark.parametrize("seed", range(3))
def test_the_reader_understands_the_sentences(seed: int) -> None:
    """Support, part, region and pose of every sentence are read back."""
    for one in by_templates(asked(seed=seed)).samples:
        request = IntentRequest(one.prompt, ObjectView(one.object, (0.2, 0.1, 0.1), ()), ROOM, (0.0, 0.0, 0.0))
        assert misread(request, one.truth(asked()), one.facing_id) == ""


def test_what_has_a_front_is_asked_to_face_something() -> None:
    """Sentences name what is faced, which the reader reads back; others know of no front."""
    asks = [one for one in feasible_asks(carrying_surfaces(ROOM), ASSETS, ROOM) if one.faced is not None]
    assert {one.asset.name for one in asks} == {"bear"}
    for ask in asks:
        one = draft_of(TemplateSample(ask, sentence(ask, 0)))
        check_sample(one, asked())
        request = IntentRequest(one.prompt, ObjectView("bear", (0.35, 0.3, 0.25), ()), ROOM, (0.0, 0.0, 0.0))
        assert misread(request, one.truth(asked()), one.facing_id) == ""
        assert misread(request, one.truth(asked()), "door_9").startswith("facing")
    with pytest.raises(ValueError, match="facing_id"):
        check_sample(
            draft(prompt="Put the mug at the center of the desk, facing the sofa.", facing_id="sofa_0"), asked()
        )


@pytest.mark.parametrize(
    ("front", "at", "y"),
    [((0, -1), (0, -2), (0, 1)), ((0, 1), (3, 0), (1, 0)), ((1, 0), (0, 2), (-1, 0)), ((-1, 0), (-2, 0), (0, 1))],
)
def test_the_truth_of_a_facing_is_that_of_the_files_axes(
    front: tuple[float, float], at: tuple[float, float], y: tuple[float, float]
) -> None:
    """Where +y of the file points once the front looks at what is faced, for fronts along each axis."""
    base, faced = (thing(name, name, (*where, 0.0), (1.0, 1.0, 1.0)) for name, where in (("a", (0, 0)), ("b", at)))
    assert asked_front(replace(BEAR, front=front), base, faced) == pytest.approx(y)


def test_the_reader_is_told_apart_from_the_truth() -> None:
    """A truth that the sentence does not say is a miss."""
    request = IntentRequest("Put the mug on the desk.", ObjectView("mug", (0.1, 0.1, 0.1), ()), ROOM, (0.0, 0.0, 0.0))
    assert misread(request, draft().truth(asked())) == ""
    assert "base desk" in misread(request, draft(base_id="night_0").truth(asked()))
    assert "region none" in misread(request, draft(regions=("center",)).truth(asked()))
    assert "pose" in misread(request, draft(top="down").truth(asked()))


def test_two_of_a_label_are_any_of_them() -> None:
    """A room with two beds has one surface "bed", and no id is expected of it."""
    beds = [one for one in carrying_surfaces(ROOM) if one.thing == "bed"]
    assert [one.several for one in beds] == [True]
    truths = [one.truth(asked()) for one in by_templates(asked(60, 0)).samples]
    assert {truth.base_id for truth in truths if truth.base == "bed"} == {""}
    assert {truth.base_id for truth in truths if truth.base == "desk"} == {"desk_0"}


def test_nothing_is_asked_that_is_there() -> None:
    """What is to be missing is not there under any name; where a thing is a guess, nothing is known to be missing."""
    absent = absent_things(ROOM)
    assert "piano" in absent
    assert not {"bed", "sofa", "desk", "nightstand"} & set(absent)
    guessed = thing("x", "box", (0, 0, 0.5), (1, 1, 1), part(0, "body", (0, 0, 0.5), (1, 1, 1)))
    object.__setattr__(guessed, "confidence", 0.4)
    assert absent_things((*ROOM, guessed)) == []


def test_a_scene_with_too_few_says_so() -> None:
    """More samples than a scene gives are refused with the number there is."""
    with pytest.raises(InputError, match=r"room: has \d+ samples, fewer than 199"):
        by_templates(SamplesRequest("room", ROOM[:3], (0.0, 0.0, 0.0), (BALL,), 199, 0, 0))
    with pytest.raises(InputError, match="nothing that can be named carries anything"):
        by_templates(SamplesRequest("empty", (), (0.0, 0.0, 0.0), ASSETS, 1, 0, 0))


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"object": "lamp"}, "object 'lamp' is not listed"),
        ({"base_id": "desk_7"}, "base_id 'desk_7' is not listed"),
        ({"base_id": "night_0"}, "does not name its base"),
        ({"part": "seat"}, "has no part 'seat'"),
        ({"any_such": True}, "is the only desk"),
        ({"prompt": "Put the mug\non the desk."}, "one line"),
        ({"object": "wardrobe", "prompt": "Put it on the bedside table.", "base_id": "night_0"}, "does not fit"),
        ({"reason": "too_large_for_target"}, "may well fit"),
        ({"reason": "target_not_found", "base_id": ""}, "the scene has desk"),
    ],
)
def test_a_reply_is_compared_with_the_scene(changes: dict[str, object], words: str) -> None:
    """What does not hold of the scene is refused with one sentence that a model can be shown."""
    request = SamplesRequest("room", ROOM, (0.0, 0.0, 0.0), ASSETS, 1, 1, 0)
    with pytest.raises(ValueError, match=words) as refused:
        SamplesReply(samples=(draft(**changes),)).check(request)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("prompt", "any_such", "told"),
    [
        ("Put the mug on the bed.", False, False),
        ("Put the mug on the bed.", True, True),
        ("Put the mug on the left bed.", False, True),
        ("Put the mug on the bed next to the desk.", False, True),
        ("Put the mug on the red bed.", False, True),
    ],
)
def test_one_of_two_beds_is_told_from_the_other(prompt: str, any_such: bool, told: bool) -> None:
    """A sentence for which either would do may not expect one of them: a method that takes the other would be wrong."""
    bed = next(one.id for one in ROOM if one.label == "bed")
    request = SamplesRequest("room", ROOM, (0.0, 0.0, 0.0), ASSETS, 1, 0, 0)
    reply = SamplesReply(samples=(draft(prompt=prompt, base_id=bed, any_such=any_such),))
    if told:
        reply.check(request)
    else:
        with pytest.raises(ValueError, match=f"nothing in it says that {bed} is meant"):
            reply.check(request)


def test_a_reply_is_counted() -> None:
    """Neither fewer samples, nor two alike, nor more refusals than asked for are taken."""
    request = SamplesRequest("room", ROOM, (0.0, 0.0, 0.0), ASSETS, 2, 0, 0)
    for samples, words in (
        ((draft(),), "1 samples, expected 2"),
        ((draft(), draft(prompt="put the mug on the desk")), "two samples"),
        ((draft(), draft(reason="too_large_for_target")), "ought to be refused"),
    ):
        with pytest.raises(ValueError, match=words):
            SamplesReply(samples=samples).check(request)


def test_splits_have_every_scene_once() -> None:
    """Sizes are the shares, by largest remainders; the order of scenes does not matter, the seed does."""
    scenes = [f"room_{number}" for number in range(21)]
    shares = shares_of("train=0.8, val=0.1, test=0.1")
    found = split_scenes(scenes, shares, 0)
    assert [len(one) for one in found.values()] == [17, 2, 2]
    assert sorted(name for one in found.values() for name in one) == sorted(scenes)
    assert split_scenes(scenes[::-1], shares, 0) == found
    assert split_scenes(scenes, shares, 1) != found


@pytest.mark.parametrize("text", ["train", "train=0.5,val=0.4", "train=1,train=0", "a=nan,b=1", "../a=1", "a=-1,b=2"])
def test_shares_that_are_none(text: str) -> None:
    """Shares have a name of their own, are positive and add up to 1."""
    with pytest.raises(InputError, match="--splits"):
        shares_of(text)


def test_a_split_without_scenes() -> None:
    """A share that rounds to no scene is refused."""
    with pytest.raises(InputError, match="val would have none of 3 scenes"):
        split_scenes(["a", "b", "c"], {"train": 0.95, "val": 0.05}, 0)


def test_articles() -> None:
    assert (with_article("apple"), with_article("mug")) == ("an apple", "a mug")


def test_supports_as_a_table() -> None:
    """A bed and a rug of three supports give way; the last row is the sum."""
    lines = supports_table({"a": ["bed", "rug", "desk", "wall"], "b": []}).splitlines()
    assert lines[1].startswith("a,4,3,2,0.6667,1,")
    assert lines[2].startswith("b,0,0,0,,0,")
    assert lines[3].startswith("all,4,3,2,0.6667,1,")
