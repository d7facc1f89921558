"""What the stage makes of a sentence and a mesh: base, scale and mass, or what is missing."""

from dataclasses import replace

import pytest
from box_rooms import ROOM, ball, block, book, segmentation, thing
from stage_chain import Stages

from dcap.scene.errors import InputError
from dcap.scene.types.choices import Intent
from dcap.scene.types.outcome import Infeasible, NotInScene, Reason
from dcap.scene.types.segmentation import Segmentation
from tasks.intent.stage import IntentConfig

OFFLINE = Stages()


@pytest.mark.parametrize(
    ("unit", "scale"),
    [(1.0, 1.0), (0.01, 0.01), (0.0254, 0.0254), (0.001, 0.001), (0.55, 1.0)],
    ids=["m", "cm", "in", "mm", "a small ball"],
)
def test_scale_undoes_the_unit(stages, unit, scale):
    """A ball of 20 cm in any unit comes out between the lexicon's limits; a plausible size is kept."""
    item = thing("ball", ball(0.1 / unit if scale != 1.0 else 0.1 * unit))
    meant = stages.meant("put the ball on the bed", item)
    assert isinstance(meant, Intent)
    assert meant.scale == pytest.approx(scale, rel=0.02)  # the icosphere's extents are 2 % short of its diameter


def test_scale_is_clamped():
    """A mesh a million times too small grows by the clamp, not more."""
    item = thing("ball", ball(1e-7))
    meant = OFFLINE.meant("put the ball on the bed", item, config=IntentConfig(largest_scale=100.0))
    assert isinstance(meant, Intent)
    assert meant.scale == 100.0


def test_given_mass_wins(stages):
    """--mass 2.5 is the mass."""
    meant = stages.meant("put the ball on the bed", thing("ball", ball()), mass=2.5)
    assert isinstance(meant, Intent)
    assert meant.mass == 2.5


@pytest.mark.parametrize("mass", [0.0, -1.0, float("nan"), float("inf")])
def test_absurd_mass_is_refused(mass):
    """Only positive finite kilograms."""
    with pytest.raises(InputError, match="mass"):
        OFFLINE.meant("put the ball on the bed", thing("ball", ball()), mass=mass)


def test_missing_target_is_infeasible_and_lists_what_is_there(stages):
    """target_not_found with the labels of the room."""
    found = stages.meant("put the ball on the piano", thing("ball", ball()))
    assert isinstance(found, Infeasible)
    assert found.reason is Reason.TARGET_NOT_FOUND
    assert "piano" in found.message
    assert "bed" in found.message
    assert isinstance(found.evidence, NotInScene)
    assert found.evidence.asked == "the piano"


def by_shape(room: Segmentation, *guesses: tuple[str, float]) -> Segmentation:
    """The room as if only their shapes named its things, all of them so."""
    label, sure = guesses[0]
    named = (
        one if one.structure else replace(one, label=label, guesses=guesses, confidence=sure) for one in room.instances
    )
    return replace(room, instances=tuple(named))


def test_a_refusal_among_guesses_says_what_settles_it():
    """What came nearest, from which likelihood on it would be taken, where the candidates are shown, both options."""
    found = OFFLINE.meant(
        "put the ball on the bench", thing("ball", ball()), by_shape(ROOM, ("stool", 0.3), ("bench", 0.1))
    )
    assert isinstance(found, Infeasible)
    for said in ("(0.10)", "0.15", "candidates.png", "--at X,Y,Z", "dcap dataset label", "--labels"):
        assert said in found.message
    assert "\n" not in found.message
    annotated = OFFLINE.meant("put the ball on the bench", thing("ball", ball()))
    assert isinstance(annotated, Infeasible)
    assert "--at" not in annotated.message


def test_what_shapes_only_guess_is_taken_with_its_likelihood():
    """The likelihood and what came second are in the notes and among the candidates."""
    room = by_shape(ROOM, ("stool", 0.6), ("bench", 0.3))
    found = OFFLINE.meant(
        "put the ball on the bench", thing("ball", ball()), room, config=IntentConfig(ambiguous="best")
    )
    assert isinstance(found, Intent)
    assert found.candidates[0].score == pytest.approx(0.3)
    assert any("by its shape, likelihood 0.30" in note for note in found.notes)


def test_a_thing_or_reference_that_is_only_guessed_is_asked_about():
    """From how sure it has to be, its id and where to look; what it says to write is taken."""
    room = by_shape(ROOM, ("stool", 0.5), ("bench", 0.3))
    found = OFFLINE.meant("put the ball on the bench", thing("ball", ball()), room)
    assert isinstance(found, Infeasible)
    for said in ("likelihood 0.30", "0.6", "candidates.png", "--at X,Y,Z", "--labels", "--ambiguous best"):
        assert said in found.message
    said = found.message.split("say which in the sentence ('")[1].split("'")[0]
    answered = OFFLINE.meant(f"put the ball on {said}", thing("ball", ball()), room)
    assert isinstance(answered, Intent)
    assert said.endswith(answered.base_id)
    beside = OFFLINE.meant("put the ball on the floor next to the bench", thing("ball", ball()), room)
    assert isinstance(beside, Infeasible)
    assert "likelihood 0.30" in beside.message


@pytest.mark.parametrize(
    ("words", "base"),
    [
        ("the left bed", "bed_a"),
        ("the right bed", "bed_b"),
        ("the bed near the window", "bed_b"),
        ("the bed next to the door", "bed_a"),
        ("the smaller bed", "bed_a"),
    ],
)
def test_one_of_two_beds_is_told_by_the_words(stages, words, base):
    """Side, neighbour and size tell them apart, from their boxes."""
    meant = stages.meant(f"put the book on {words}", thing("book", book()), two_beds())
    assert isinstance(meant, Intent)
    assert (meant.base_id, meant.base_label) == (base, "bed")


def two_beds() -> Segmentation:
    """A smaller bed by the door at -x and a larger one by the window at +x, both with their feet to -y."""
    ahead = (0.0, -1.0, 0.0)
    return segmentation(
        {
            "bed_a": ("bed", ahead, [("mattress", block((-1.9, -1.0, 0.0), (-1.0, 1.0, 0.5)))]),
            "bed_b": ("bed", ahead, [("mattress", block((0.4, -1.0, 0.0), (1.9, 1.0, 0.5)))]),
            "door": ("door", None, [("body", block((-2.1, -0.5, 0.0), (-2.0, 0.5, 2.0)))]),
            "window": ("window", None, [("body", block((2.0, -0.5, 0.8), (2.1, 0.5, 2.0)))]),
        }
    )
