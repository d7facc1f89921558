"""What the offline reader understands, sentence by sentence, in a room with two beds."""

from dataclasses import replace
from pathlib import Path

import pytest

from dcap.language.offline.client import OfflineClient
from dcap.language.offline.placing import object_name
from dcap.language.offline.pose_choice import chosen_part
from dcap.language.protocol.questions import INTENT
from dcap.language.protocol.requests import AnchorRequest, PartView
from dcap.scene.errors import LanguageError
from dcap.scene.types.outcome import cautions

# prompt | base | part | which | regions | references | pose | facing
SENTENCES = """
put the ball on the sofa | sofa_0 | | | | | any |
I want to put the ball at the center of the left bed | bed_0 | | | center | | any |
Place the mug upside down on the desk | desk_0 | | | | | upside_down |
put the mug bottom up on the desk | desk_0 | | | | | upside_down |
Lay the vase on its side on the desk. | desk_0 | | | | | on_side |
lay the vase on the desk | desk_0 | | | | | lying |
stand the book on the desk | desk_0 | | | | | upright |
put the plush toy on the right bed facing the pillow | bed_1 | | | | | any | part:pillow
put the teddy on the sofa looking at the window | sofa_0 | | | | | any | window_0
put the teddy with its back to the wall on the sofa | sofa_0 | | | | | any | away:wall_0
put the teddy on the desk facing me | desk_0 | | | | | any | viewer
put the toy car on the desk facing left | desk_0 | | | | | any | left
set the laptop on the left side of the desk | desk_0 | | | left | | any |
set the book at the left edge of the desk | desk_0 | | | left,edge | | any |
put the ball in the front left corner of the sofa | sofa_0 | | | front,left,corner | | any |
put the ball near the edge of the desk | desk_0 | | | edge | | any |
put the ball on the edge of the desk | desk_0 | | | edge | | any |
place the book on the second shelf | shelf_0 | board | 2 | | | any |
place the book on the second shelf from the top | shelf_0 | board | 2 from top | | | any |
place the book on the top shelf of the bookcase | shelf_0 | board | top | | | any |
put the vase on the lower shelf | shelf_0 | board | bottom | | | any |
put the pillow on the left bed | bed_0 | | | | | any |
put the pillow on the bed near the window | bed_1 | | | | | any |
put the pillow on the bed, the one near the door | bed_0 | | | | | any |
put the pillow on the bed that is next to the window | bed_1 | | | | | any |
put the ball on the red bed | bed_1 | | | | | any |
put the ball on the blue bed | bed_0 | | | | | any |
put the book on the left bed near the headboard | bed_0 | | | near | part:headboard | any |
put the ball on the right bed next to the pillow | bed_1 | | | next_to | part:pillow | any |
put the apple between the pillows on the left bed | bed_0 | | | between | part:pillow | any |
put the blanket at the foot of the left bed | bed_0 | | | foot | | any |
put the towel at the head of the right bed | bed_1 | | | head | | any |
put the ball on the pillow of the left bed | bed_0 | pillow | | | | any |
put the ball on the left pillow of the right bed | bed_1 | pillow | left | | | any |
put the mug next to the laptop | desk_0 | | | next_to | laptop_0 | any |
put the mug on the desk next to the laptop | desk_0 | | | next_to | laptop_0 | any |
put the mug to the left of the laptop | desk_0 | | | left,next_to | laptop_0 | any |
put the mug in front of the laptop | desk_0 | | | front,next_to | laptop_0 | any |
put the mug on the nightstand | night_0 | | | | | any |
put the mug near the lamp | night_0 | | | near | lamp_0 | any |
place the ball on the lampshade | lamp_0 | shade | | | | any |
drop the ball on the shade of the lamp | lamp_0 | shade | | | | any |
put the shoe on the floor next to the door | floor_0 | | | next_to | door_0 | any |
put the shoe on the ground | floor_0 | | | | | any |
put the ball in the middle of the room | floor_0 | | | middle | | any |
put the ball under the desk | floor_0 | | | under | desk_0 | any |
put the cushion on the seat of the chair | chair_0 | seat | | | | any |
put the cat on the arm of the sofa | sofa_0 | arm | | | | any |
put the ball on the right arm of the sofa | sofa_0 | arm | right | | | any |
place the dumbbell on the back of the sofa | sofa_0 | back | | | | any |
place the dumbbell at the back of the sofa | sofa_0 | | | back | | any |
ball on couch | sofa_0 | | | | | any |
on the couch | sofa_0 | | | | | any |
Could you please gently set the mug down on the desk? | desk_0 | | | | | any |
pick up the book and place it on the desk | desk_0 | | | | | any |
pick up the mug near the laptop and put it on the bedside table | night_0 | | | | | any |
flip the mug and put it on the desk | desk_0 | | | | | upside_down |
the ball should lie on the sofa | sofa_0 | | | | | any |
put the ball on the sofa, on the left | sofa_0 | | | left | | any |
put the ball on the sofa in the corner | sofa_0 | | | corner | | any |
put the plush toy on its back on the sofa | sofa_0 | | | | | on_back |
put the book face down on the desk | desk_0 | | | | | on_front |
lay the dumbbell flat on the sofa cushion | sofa_0 | seat cushion | | | | lying |
place the towel over the arm of the couch | sofa_0 | arm | | | | any |
put the mug on the bedside table beside the table lamp | night_0 | | | next_to | lamp_0 | any |
put the ball on the mattress of the right bed | bed_1 | mattress | | | | any |
put the ball on the desk left of the centre | desk_0 | | | left | | any |
put the ball right of the middle of the desk | desk_0 | | | right | | any |
put the ball on the desk, behind the middle | desk_0 | | | back | | any |
put the ball on the sofa, then move it to the left | sofa_0 | | | left | | any |
put the ball on the sofa and place it on the seat cushion | sofa_0 | seat cushion | | | | any |
put pillow on bed what is closest at the window | bed_1 | | | | | any |
could I have the mug on the desk | desk_0 | | | | | any |
put the book on top of the tall shelf | shelf_0 | board | top | | | any |
put the book on the tall shelf | shelf_0 | board | tallest | | | any |
""".strip().splitlines()


def test_sentences_are_read_as_a_person_reads_them(ask, subtests: pytest.Subtests):
    """Base, part, region, reference, pose and facing are those a person would name."""
    for line in SENTENCES:
        with subtests.test(line):
            prompt, *wanted = (cell.strip() for cell in line.split("|"))
            reply = OfflineClient().ask(INTENT, ask(prompt))
            found = [
                reply.base_id,
                reply.part,
                reply.which,
                ",".join(reply.regions),
                ",".join(reply.references),
                reply.pose,
                reply.facing,
            ]
            assert found == wanted


@pytest.mark.parametrize(
    "prompt",
    [
        "",
        "   ",
        "asdf qwer",
        "turn on the stove",
        "put the mug and the book on the table",
        "put both pillows on the bed",
        "stack the left bowl on the right bowl and place them in the tray",
        "don't put the ball on the bed",
        "put the ball upside down",
        "put it",
        "what is on the bed?",
        "Leg den Ball auf das Bett",
    ],
)
def test_what_is_no_placement_of_one_thing_is_refused(prompt, ask):
    """Nothing is guessed: an empty, foreign, negated or multiple request raises LanguageError in one line."""
    with pytest.raises(LanguageError) as error:
        OfflineClient().ask(INTENT, ask(prompt))
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("prompt", "missing"),
    [
        ("put the vase on the piano", "piano"),
        ("put the ball on the flurbish", "flurbish"),
        ("put the ball next to the aquarium", "aquarium"),
        ("put the ball on the bed next to the fireplace", "fireplace"),
        ("place the book on the bathtub rim", "bathtub"),
    ],
)
def test_missing_things_are_named(prompt, missing, ask):
    """A target that is not there gives no base, says what is missing and what there is."""
    reply = OfflineClient().ask(INTENT, ask(prompt))
    assert reply.base_id == ""
    assert missing in reply.missing


@pytest.mark.parametrize(
    ("prompt", "word"),
    [
        ("put the akita bowl on the desk", "akita"),
        ("put the ball on the desk opposite the laptop", "opposite the laptop"),
        ("put the ball quixotically on the desk", "quixotically"),
        ("put the mug on the desk facing the television", "facing the television"),
        ("put the mug on the desk left of the edge", "left of the edge"),
        ("put the mug on the desk near 10 cm", "near 10 cm"),
        ("put the mug on the desk, then move it to the bed", "to the bed"),
    ],
)
def test_leftover_words_are_reported(prompt, word, ask):
    """What the reader cannot use is listed, not dropped."""
    reply = OfflineClient().ask(INTENT, ask(prompt))
    assert reply.base_id == "desk_0"
    assert word in reply.not_understood


@pytest.mark.parametrize(
    ("prompt", "label", "name"),
    [
        ("put the ball on the bed", "basketball", "basketball"),
        ("put the ball on the bed", "textured", "ball"),
        ("put it on the bed", "obj mug ycb", "mug"),
        ("put the toy on the bed", "koala low resolution", "plush toy"),
        ("put the book on the bed", "ball", "book"),
        ("put the frobnicator on the bed", "thing", "frobnicator"),
        ("put the cheese mangler on the bed", "thing", "cheese mangler"),
        ("put the cheese grater on the bed", "thing", "grater"),
    ],
)
def test_the_more_specific_name_gives_the_prior(prompt, label, name, ask):
    """The prompt's noun counts unless the file's name is a kind of it."""
    assert OfflineClient().ask(INTENT, ask(prompt, label)).object_name == name


def test_a_wider_label_is_taken_and_said(ask):
    """An office chair may be labelled as a chair: it is taken, and a note says so."""
    reply = OfflineClient().ask(INTENT, ask("put the book on the office chair"))
    assert reply.base_id == "chair_0"
    assert "using the chair as the office chair" in reply.notes


HASH = "0a1b2c3d4e5f60718293a4b5c6d7e8f9"


@pytest.mark.parametrize(
    ("path", "prompt", "given", "name"),
    [
        (f"glbs/000-023/{HASH}.glb", "put the tennis ball on the bed", "", "tennis ball"),
        (f"glbs/000-023/{HASH}.glb", "put the tennis ball on the bed", "juggling_ball", "juggling ball"),
        (f"glbs/000-023/{HASH}.glb", "put it on the bed", "", "object"),
        (f"glbs/000-023/{HASH}.glb", "put the ball on the bed", HASH, "ball"),
        ("objects/B07XJ8C8F5.glb", "put the gizmo on the bed", "", "gizmo"),
        ("objects/plush_bear.glb", "put the toy on the bed", "", "plush bear"),
        ("my_mug/textured.obj", "put the cup on the desk", "", "my mug"),
        (f"{HASH}/textured.obj", "put the cup on the desk", "", "cup"),
    ],
)
def test_names(path: str, prompt: str, given: str, name: str):
    """In that order; a folder counts where the file is called what every mesh is called."""
    assert object_name(Path(path), prompt, given) == name


HEIGHTS = {"case with a roof": (0.09, 0.39, 0.70, 1.00), "three boards": (0.1, 0.5, 0.9)}


def board_height(which: str, heights: tuple[float, ...]) -> float:
    """Height of the board that is chosen [m]."""
    parts = tuple(PartView(i, "board", (0.0, 0.0, z), (0.8, 0.3, 0.02), 0.24) for i, z in enumerate(heights))
    request = AnchorRequest(
        prompt="", region_words="", object_name="book", footprint=(0.2, 0.15), base_label="bookcase", parts=parts,
        asked_part="board", asked_which=which, asked_regions=(), asked_references=(), right=(1.0, 0.0, 0.0),
        front=(0.0, -1.0, 0.0),
    )  # fmt: skip
    return chosen_part(request)[0].center[2]


@pytest.mark.parametrize(
    ("which", "case", "height"),
    [
        ("middle", "case with a roof", 0.39),
        ("middle", "three boards", 0.5),
        ("bottom", "case with a roof", 0.09),
        ("2 from bottom", "case with a roof", 0.39),
        ("2 from top", "three boards", 0.5),
        ("top", "three boards", 0.9),
    ],
)
def test_board_that_is_meant(which, case, height):
    assert board_height(which, HEIGHTS[case]) == height


def test_a_second_choice_has_no_effect_and_that_is_told(ask):
    """ "Or else on the desk": the first choice is tried, and a caution says that the other one is not."""
    reply = OfflineClient().ask(INTENT, ask("put the blanket on the left bed, or else on the desk"))
    assert (reply.base_id, reply.not_understood) == ("bed_0", ())
    assert any("'or else on the desk' has no effect" in note for note in cautions(reply.notes))


def test_one_file_is_one_thing_whatever_its_name(ask):
    """A file of three candles is placed as a whole; two things of which it is one are not."""
    asked = ask("put the candles on the desk")
    candles = replace(asked, item=replace(asked.item, label="candles"))
    assert OfflineClient().ask(INTENT, candles).base_id == "desk_0"
    with pytest.raises(LanguageError, match="more than one thing"):
        OfflineClient().ask(INTENT, replace(candles, prompt="put the candles and the mug on the desk"))
