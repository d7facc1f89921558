"""Where things go in rooms made of boxes, whose answers can be computed by hand, and why they do not go at all."""

import numpy as np
import pytest
from box_rooms import CUBE, HALL, ROOM, Things, ball, block, mug, segmentation, thing
from stage_chain import Stages, with_each

from dcap.geometry.placement.poses import center_of_mass
from dcap.geometry.raycast import Raycaster
from dcap.language.protocol.replies import AnchorReply
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.outcome import BesideThePart, Infeasible, NoRoom, Reason
from dcap.scene.types.segmentation import Segmentation
from tasks.anchor.choice import choice_of

OFFLINE = Stages()


def brute_gap(room: Segmentation, mesh: Mesh, step: float = 0.002) -> float:
    """Smallest vertical gap on a fine grid of columns through the object [m]."""
    low, high = mesh.bounds
    x, y = np.meshgrid(np.arange(low[0], high[0], step), np.arange(low[1], high[1], step))
    below = np.c_[x.ravel(), y.ravel(), np.full(x.size, low[2] - 0.5)]
    under = Raycaster(mesh).cast(below, np.tile([0.0, 0.0, 1.0], (len(below), 1)))
    hit = under.face >= 0
    start = under.position[hit]
    return float(Raycaster(room.mesh).cast(start, np.tile([0.0, 0.0, -1.0], (len(start), 1))).distance.min())


PROMPTS = [
    ("put the ball at the center of the bed", "mattress"),
    ("put the ball on the bed next to the pillow", "mattress"),
    ("put the ball on the left pillow of the bed", "pillow"),
    ("put the ball on the table next to the lamp", "top"),
    ("put the ball on the lampshade", "shade"),
    ("put the ball on the floor near the bed", "floor"),
]


@pytest.mark.parametrize(("prompt", "part"), PROMPTS)
def test_start_leaves_one_centimetre_under_the_whole_object(prompt, part):
    """The smallest vertical gap is 1 cm, the asked part is hit, the centre of mass is over the anchor."""
    item = thing("ball", ball(0.06))
    _, _, found = OFFLINE.placed(prompt, item)
    mesh = item.mesh.transformed(found.world_from_object)
    # never less; columns 2 mm apart miss the tip of a cone of slope 1 by up to 1.4 mm, a sphere's lowest point by 8 um
    assert 0.01 - 1e-5 <= brute_gap(ROOM, mesh) <= 0.0115
    assert found.part == part
    assert np.allclose(center_of_mass(mesh)[:2], found.surface_point[:2], atol=1e-6)


@pytest.mark.parametrize(
    ("stages", "words", "low", "high"),
    with_each(
        [
            ("at the center of the bed", (-0.27, -0.34), (0.27, 0.34)),
            ("on the left side of the bed", (-0.75, -0.95), (0.0, 0.95)),
            ("on the right side of the bed", (0.0, -0.95), (0.75, 0.95)),
            ("on the foot of the bed", (-0.75, -0.95), (0.75, -0.28)),
            ("in the front left corner of the bed", (-0.75, -0.95), (-0.45, -0.6)),
            ("on the right edge of the bed", (0.45, -0.95), (0.75, 0.95)),
            ("on the bed near the headboard", (-0.75, 0.2), (0.75, 0.95)),
            ("between the pillows on the bed", (-0.35, 0.3), (0.35, 0.95)),
        ],
        "on the left side of the bed",
        "on the bed near the headboard",
    ),
    indirect=["stages"],
)
def test_regions_are_where_a_viewer_at_the_foot_sees_them(stages, words, low, high):
    """The anchor lies in the rectangle that the words mean, and in the polygon that judges the outcome."""
    _, _, found = stages.placed(f"put the cube {words}", CUBE)
    assert found.part == "mattress"
    x, y = found.surface_point[:2]
    assert low[0] - 1e-6 <= x <= high[0] + 1e-6
    assert low[1] - 1e-6 <= y <= high[1] + 1e-6
    polygon = found.region_polygon
    edges = np.roll(polygon, -1, axis=0) - polygon
    cross = edges[:, 0] * (y - polygon[:, 1]) - edges[:, 1] * (x - polygon[:, 0])
    assert (cross >= -1e-9).all()


def test_what_lies_there_is_respected():
    """Next to the lamp on the table: the object's box does not meet the lamp's base."""
    item = thing("mug", mug())
    _, _, found = OFFLINE.placed("put the mug on the table", item)
    mesh = item.mesh.transformed(found.world_from_object)
    low, high = mesh.bounds
    base = ROOM.instances[2].parts[1].box
    apart = np.maximum(low - (base.center + base.half_extents), (base.center - base.half_extents) - high)
    assert apart.max() > 0


def test_too_large_says_so_with_numbers(stages):
    """A thing of 2 m on a table of 0.8 m is too large; footprint and part size are in message and evidence."""
    item = thing("sofa", block((-1.0, -0.45, 0.0), (1.0, 0.45, 0.8)))
    found = stages.tried("put the sofa on the table", item)
    assert isinstance(found, Infeasible)
    assert found.reason is Reason.TOO_LARGE_FOR_TARGET
    assert "0.90 x 2.00" in found.message
    assert isinstance(found.evidence, NoRoom)
    assert found.evidence.part_size_m == (0.8, 0.8)


def test_shelf_boards_have_headroom():
    """The second board of three is hit although another is above it; a thing higher than the gap does not fit."""
    boards = [("board", block((-0.4, -0.15, 0.4 * k), (0.4, 0.15, 0.4 * k + 0.02))) for k in range(3)]
    room = segmentation({"shelf": ("shelf", (0.0, -1.0, 0.0), boards)})
    _, _, found = OFFLINE.placed("put the ball on the second shelf", thing("ball", ball(0.1)), room)
    assert found.part_index == 1
    assert found.surface_point[2] == pytest.approx(0.42)
    tall = thing("vase", block((-0.05, -0.05, 0.0), (0.05, 0.05, 0.39)))
    assert isinstance(OFFLINE.tried("put the vase on the second shelf", tall, room), Infeasible)


def test_point_is_one_of_the_part_that_was_chosen():
    """Right and front of a blanket on the lower half are 0.75 and -0.95 m of the room; without a point a choice of the
    blanket means the bed's middle."""
    bed = [
        ("mattress", block((-0.75, -0.95, 0.3), (0.75, 0.95, 0.5))),
        ("blanket", block((-0.75, -0.95, 0.501), (0.75, 0.1, 0.55))),
    ]
    room, item = segmentation({"bed": ("bed", (0.0, -1.0, 0.0), bed)}), thing("tennis ball", ball(0.033))
    meant, _, _ = OFFLINE.placed("put the ball on the bed", item, room)
    # half the way to the right: 0.375 m; half the way to the front: from -0.425 by half of 0.525 m
    pointed = choice_of(room, room.instances[0], meant, AnchorReply(part_index=1, point=(0.5, 0.5)), item.mesh)
    plain = choice_of(room, room.instances[0], meant, AnchorReply(part_index=1), item.mesh)
    assert (pointed.index, plain.index) == (1, 0)
    assert np.allclose(pointed.areas[0].target, (0.375, -0.6875))
    assert np.allclose(plain.areas[0].target, (0.0, 0.0))


@pytest.mark.parametrize(
    ("words", "low", "high"),
    [
        ("in front of the bench", (-0.6, -1.5), (0.6, -1.2)),
        # the viewer stands in the room and looks along -y: his left is +x
        ("to the left of the bench", (0.5, -2.0), (0.8, -1.4)),
        ("in front of the door", (-2.0, 0.1), (-1.6, 1.3)),
    ],
)
def test_beside_a_thing_on_the_floor_its_own_front_counts(words, low, high):
    """Left and front are those of the bench; a door is seen from the room although its own front looks out of it."""
    _, _, found = OFFLINE.placed(f"put the ball on the floor {words}", thing("ball", ball(0.1)), HALL)
    assert (np.array(low) <= found.surface_point[:2]).all()
    assert (found.surface_point[:2] <= np.array(high)).all()


def test_neighbour_says_which_one_is_meant(stages):
    """ "The chair next to the bench" is no place on the chair; "on the chair next to the stove" 3 m away is refused."""
    mug_thing = thing("mug", mug())
    _, _, found = stages.placed("put the mug on the chair next to the bench", mug_thing, HALL)
    assert found.base_id == "chair"
    assert found.region == "center"
    assert "selecting the chair" in found.notes[0]
    refused = stages.tried("put the mug on the chair next to the stove", mug_thing, HALL)
    assert isinstance(refused, Infeasible)
    assert refused.reason is Reason.NO_SUPPORT_HIT
    # the chair's corner (0.9, -1.5) to the stove's (0.3, 1.6), less 15 cm and half of the mug, whose sides are 8.4 to
    # 11.7 cm long as it is turned; a hull of 16 corners lies inside of its circle by 1 - cos(pi / 16) = 2 %
    far = np.hypot(0.6, 3.1)
    assert isinstance(refused.evidence, BesideThePart)
    assert far - (0.15 + 0.117 / 2) <= refused.evidence.beside_m <= far - 0.98 * (0.15 + 0.084 / 2)
    assert f"{refused.evidence.beside_m:.2f} m from the seat of chair" in refused.message
    assert "no ray" not in refused.message


@pytest.mark.parametrize(("words", "signs"), [("arm", (-1, 1)), ("right arm", (1,)), ("left arm", (-1,))])
def test_near_a_part_of_two_pieces_is_near_one_of_them(words, signs):
    """The arms of a sofa are one part; "next to the arm" is at one of its ends, not between them; the viewer's
    right is +x."""
    arms = Mesh.concatenate([block((x, -0.4, 0.0), (x + 0.2, 0.4, 0.6)) for x in (-1.1, 0.9)])
    parts = [("seat cushion", block((-0.9, -0.4, 0.2), (0.9, 0.4, 0.4))), ("arm", arms)]
    room = segmentation({"sofa": ("sofa", (0.0, -1.0, 0.0), parts)})
    _, _, found = OFFLINE.placed(f"put the ball on the sofa next to the {words}", thing("ball", ball(0.1)), room)
    assert np.sign(found.surface_point[0]) in signs
    assert 0.9 - 0.15 - 0.2 <= abs(found.surface_point[0]) <= 0.9 - 0.1 + 0.01


def test_full_target_names_what_is_in_the_way():
    """A desk covered with books but for gaps of 5 cm: too large, with the books and the lamp by name."""
    things: Things = {"desk": ("desk", (0.0, -1.0, 0.0), [("top", block((-0.6, -0.3, 0.7), (0.6, 0.3, 0.74)))])}
    for row in range(4):
        low = (-0.6 + 0.25 * row, -0.3, 0.74)
        things[f"book_{row}"] = ("book", None, [("body", block(low, (low[0] + 0.2, 0.3, 0.8)))])
    things["lamp"] = ("table lamp", None, [("base", block((0.4, -0.3, 0.74), (0.6, 0.3, 1.0)))])
    room, item = segmentation(things), thing("bowl", ball(0.1))
    found = OFFLINE.tried("put the bowl on the desk", item, room)
    assert isinstance(found, Infeasible)
    assert found.reason is Reason.TOO_LARGE_FOR_TARGET
    assert "in the way: book" in found.message
    assert isinstance(found.evidence, NoRoom)
    assert found.evidence.blocked_share == 1.0
    assert {row.id for row in found.evidence.in_the_way} <= {*things}


@pytest.mark.slow
@pytest.mark.long
def test_a_steady_place_nearby_is_taken():
    """A ball meant for the crest of a fold, 5 cm high and 40 cm wide, goes beside it; on a bed that slopes all over, or
    is so narrow that the crest is all there is, it stays at the middle, unless nobody asked for the middle."""
    heights = ((-0.95, 0.5), (-0.2, 0.5), (0.0, 0.55), (0.2, 0.5), (0.95, 0.5))
    faces = [face for k in range(4) for face in ((k, k + 5, k + 1), (k + 1, k + 5, k + 6))]
    fold, narrow = (Mesh.of([(x, y, z) for x in (-w, w) for y, z in heights], faces) for w in (0.75, 0.15))
    slope = Mesh.of([(x, y, 0.5 + 0.2 * y) for x in (-0.75, 0.75) for y in (-0.95, 0.95)], [(0, 2, 1), (1, 2, 3)])
    for surface, words, low, high in (
        (fold, "at the center of", 0.15, 0.4),
        (slope, "at the center of", 0.0, 0.02),
        (narrow, "at the center of", 0.0, 0.02),
        (narrow, "on", 0.15, 0.4),
        (slope, "on", 0.0, 0.02),
    ):
        room = segmentation({"bed": ("bed", (0.0, -1.0, 0.0), [("mattress", surface)])})
        _, _, found = OFFLINE.placed(f"put the ball {words} the bed", thing("ball", ball(0.1)), room)
        assert low <= abs(found.surface_point[1]) <= high
