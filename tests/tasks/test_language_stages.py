"""Intent, rotation, anchor and materials on rooms made of boxes, whose answers can be computed by hand."""

from dataclasses import replace

import numpy as np
import pytest
from box_rooms import HALL, ROOM, ball, block, book, mug, segmentation, thing, toy

from geometry.poses import about_z, center_of_mass
from geometry.raycast import Raycaster
from language.replies import RotationReply
from language.requests import FacingView, RotationRequest
from language.seam import ClientName, LanguageConfig
from scene.anchor import Anchor
from scene.errors import InputError, LanguageError
from scene.intent import Intent
from scene.materials import Model, PartMaterials
from scene.mesh import Mesh
from scene.outcome import Infeasible, Reason
from scene.rotation import Rotation
from scene.segmentation import Segmentation
from tasks.anchor import AnchorConfig, anchor
from tasks.intent import IntentConfig, intent
from tasks.materials import MaterialsConfig, materials
from tasks.rotation import RotationConfig, matrix_of, pose_views, rotation

SMALL = RotationConfig(picture_size=64)


def placed(prompt: str, item: Segmentation, room: Segmentation = ROOM) -> tuple[Intent, Rotation, Anchor]:
    meant = intent(room, item, prompt, None, IntentConfig())
    assert isinstance(meant, Intent)
    turned = rotation(room, item, meant, prompt, SMALL)
    assert isinstance(turned, Rotation)
    found = anchor(room, item, meant, turned, AnchorConfig())
    assert isinstance(found, Anchor), found
    return meant, turned, found


def oriented(prompt: str, item: Segmentation) -> Rotation:
    """Intent and rotation only."""
    meant = intent(ROOM, item, prompt, None, IntentConfig())
    assert isinstance(meant, Intent)
    turned = rotation(ROOM, item, meant, prompt, SMALL)
    assert isinstance(turned, Rotation)
    return turned


def brute_gap(room: Segmentation, mesh: Mesh, step: float = 0.002) -> float:
    """Smallest vertical gap on a fine grid of columns through the object [m]."""
    low, high = mesh.bounds
    x, y = np.meshgrid(np.arange(low[0], high[0], step), np.arange(low[1], high[1], step))
    below = np.c_[x.ravel(), y.ravel(), np.full(x.size, low[2] - 0.5)]
    under = Raycaster(mesh).cast(below, np.tile([0.0, 0.0, 1.0], (len(below), 1)))
    hit = under.face >= 0
    start = under.position[hit]
    return float(Raycaster(room.mesh).cast(start, np.tile([0.0, 0.0, -1.0], (len(start), 1))).distance.min())


# intent -------------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("unit", "scale"),
    [(1.0, 1.0), (0.01, 0.01), (0.0254, 0.0254), (0.001, 0.001), (0.55, 1.0)],
    ids=["m", "cm", "in", "mm", "a small ball"],
)
def test_scale_undoes_the_unit(unit, scale):
    """A ball of 20 cm in any unit comes out between the lexicon's limits; a plausible size is kept."""
    item = thing("ball", ball(0.1 / unit if scale != 1.0 else 0.1 * unit))
    meant = intent(ROOM, item, "put the ball on the bed", None, IntentConfig())
    assert isinstance(meant, Intent)
    assert meant.scale == pytest.approx(scale, rel=0.02)  # the icosphere's extents are 2 % short of its diameter


def test_scale_is_clamped():
    """A mesh a million times too small grows by the clamp, not more."""
    item = thing("ball", ball(1e-7))
    meant = intent(ROOM, item, "put the ball on the bed", None, IntentConfig(largest_scale=100.0))
    assert isinstance(meant, Intent)
    assert meant.scale == 100.0


def test_given_mass_wins():
    """--mass 2.5 is the mass."""
    meant = intent(ROOM, thing("ball", ball()), "put the ball on the bed", 2.5, IntentConfig())
    assert isinstance(meant, Intent)
    assert meant.mass == 2.5


@pytest.mark.parametrize("mass", [0.0, -1.0, float("nan"), float("inf")])
def test_absurd_mass_is_refused(mass):
    """Only positive finite kilograms."""
    with pytest.raises(InputError, match="mass"):
        intent(ROOM, thing("ball", ball()), "put the ball on the bed", mass, IntentConfig())


def test_mass_follows_the_size():
    """A book one and a half times as long, wide and thick weighs 1.5^3 times as much, within the clamp of 5."""
    small = intent(ROOM, thing("book", book()), "put the book on the bed", None, IntentConfig())
    pose = np.diag([1.5, 1.5, 1.5, 1.0])
    large = intent(ROOM, thing("book", book().transformed(pose)), "put the book on the bed", None, IntentConfig())
    assert isinstance(small, Intent)
    assert isinstance(large, Intent)
    assert large.mass / small.mass == pytest.approx(1.5**3, rel=1e-6)


def test_missing_target_is_infeasible_and_lists_what_is_there():
    """target_not_found with the labels of the room."""
    found = intent(ROOM, thing("ball", ball()), "put the ball on the piano", None, IntentConfig())
    assert isinstance(found, Infeasible)
    assert found.reason is Reason.TARGET_NOT_FOUND
    assert "piano" in found.message
    assert "bed" in found.message
    assert found.evidence["asked"] == "the piano"


@pytest.mark.parametrize("prompt", ["", "hello there", "x" * 2000])
def test_useless_prompts_are_refused(prompt):
    """Exit code 2 and nothing placed."""
    with pytest.raises((LanguageError, InputError)) as error:
        intent(ROOM, thing("ball", ball()), prompt, None, IntentConfig())
    assert error.value.exit_code == 2


def test_book_is_the_object_and_bed_the_base():
    """A known noun after the relation is the base, whatever the file's name."""
    meant = intent(ROOM, thing("bed sheet", book()), "put the book on the bed", None, IntentConfig())
    assert isinstance(meant, Intent)
    assert (meant.object_name, meant.base_id) == ("book", "bed")


# rotation -----------------------------------------------------------------------------------------------------------


def test_three_pictures_and_a_rotation():
    """Exactly three different pictures of the asked size, one orthonormal matrix."""
    turned = oriented("put the mug on the bed", thing("mug", mug()))
    assert [p.shape for p in turned.pictures] == [(64, 64, 3)] * 3
    assert not np.array_equal(turned.pictures[0], turned.pictures[2])
    assert np.allclose(turned.matrix @ turned.matrix.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(turned.matrix) == pytest.approx(1.0)


def up_of(turned: Rotation) -> np.ndarray:
    return turned.matrix[:, 2]


@pytest.mark.parametrize(
    ("words", "vertical"),
    [("", 1.0), ("upright", 1.0), ("upside down", -1.0), ("on its side", 0.0), ("lying down", 0.0), ("standing", 1.0)],
)
def test_words_turn_the_mug(words, vertical):
    """The mug's own axis points up, down or sideways as the words say (15 degrees)."""
    turned = oriented(f"put the mug {words} on the bed", thing("mug", mug()))
    assert up_of(turned)[2] == pytest.approx(vertical, abs=np.sin(np.radians(15)))


@pytest.mark.parametrize(
    ("words", "height"), [("", 0.03), ("lying flat", 0.03), ("standing", 0.23), ("on its side", 0.16)]
)
def test_words_turn_the_book(words, height):
    """A book lies on its largest face unless told otherwise, however its file has it."""
    upright = book().transformed(np.array([[0, 0, 1, 0], [0, 1, 0, 0], [-1, 0, 0, 0], [0, 0, 0, 1]], dtype=float))
    for mesh in (book(), upright):
        turned = oriented(f"put the book {words} on the bed", thing("book", mesh))
        assert np.ptp(mesh.vertices @ turned.matrix.T, axis=0)[2] == pytest.approx(height, abs=1e-3)


@pytest.mark.parametrize(
    ("words", "direction"),
    [
        ("facing the pillows", (0, 1)),
        ("facing the wall", (0, 1)),
        ("facing away from the wall", (0, -1)),
        ("facing me", (0, -1)),
        ("facing left", (-1, 0)),
        ("", (0, -1)),
    ],
)
def test_front_looks_where_the_words_say(words, direction):
    """The toy's front, -y in its mesh, points there; without words to the bed's front (15 degrees)."""
    turned = oriented(f"put the teddy on the bed {words}", thing("teddy", toy()))
    ahead = turned.matrix @ (0.0, -1.0, 0.0)
    assert float(ahead[:2] @ direction) > np.cos(np.radians(15))


def test_yaw_is_aligned_with_the_support():
    """A book whose file is turned by 30 degrees lies parallel to the bed: its extents are those of the unturned one."""
    pose = np.eye(4)
    pose[:3, :3] = about_z(np.radians(30))
    mesh = book().transformed(pose)
    turned = oriented("put the book on the bed", thing("book", mesh))
    extents = np.ptp(mesh.vertices @ turned.matrix.T, axis=0)
    assert np.sort(extents[:2]) == pytest.approx([0.16, 0.23], abs=1e-6)


def test_any_rotation_may_be_chosen():
    """A quaternion in the reply is the rotation, also where it is no listed pose; unit length is checked."""
    half = np.sqrt(0.5)
    reply = RotationReply(pose_id="upright", quaternion=(half, half, 0.0, 0.0))
    request = RotationRequest("", "mug", "any", "", pose_views(mug(), np.eye(3), ""), (), 1, False)
    matrix = matrix_of(reply, request, ROOM, ROOM.instances[0], mug())
    assert np.allclose(matrix @ (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), atol=1e-12)
    facings = (FacingView("aligned", (0.0, -1.0, 0.0)),)
    listed = replace(request, facings=facings)
    reply.check(listed)
    with pytest.raises(ValueError, match="length"):
        RotationReply(pose_id="upright", quaternion=(1.0, 1.0, 0.0, 0.0)).check(listed)


# anchor -------------------------------------------------------------------------------------------------------------

PROMPTS = [
    ("put the ball at the center of the bed", "mattress"),
    ("put the ball on the left side of the bed", "mattress"),
    ("put the ball on the bed next to the pillow", "mattress"),
    ("put the ball on the foot of the bed", "mattress"),
    ("put the ball on the left pillow of the bed", "pillow"),
    ("put the ball on the edge of the table", "top"),
    ("put the ball on the table next to the lamp", "top"),
    ("put the ball on the lampshade", "shade"),
    ("put the ball on the headboard", "headboard"),
    ("put the ball on the floor near the bed", "floor"),
]


@pytest.mark.parametrize(("prompt", "part"), PROMPTS)
def test_start_leaves_one_centimetre_under_the_whole_object(prompt, part):
    """The smallest vertical gap is 1 cm, the asked part is hit, the centre of mass is over the anchor."""
    item = thing("ball", ball(0.06))
    _, _, found = placed(prompt, item)
    mesh = item.mesh.transformed(found.world_from_object)
    # never less; columns 2 mm apart miss the tip of a cone of slope 1 by up to 1.4 mm, a sphere's lowest point by 8 um
    assert 0.01 - 1e-5 <= brute_gap(ROOM, mesh) <= 0.0115
    assert found.part == part
    assert np.allclose(center_of_mass(mesh)[:2], found.surface_point[:2], atol=1e-6)


def test_handle_may_reach_over_the_pillow_but_not_into_it():
    """Also for a shape with an overhang the gap is 1 cm everywhere."""
    item = thing("mug", mug())
    _, _, found = placed("put the mug on the bed near the pillow", item)
    mesh = item.mesh.transformed(found.world_from_object)
    assert brute_gap(ROOM, mesh, 0.001) == pytest.approx(0.01, abs=3e-4)
    assert mesh.bounds[0, 2] == pytest.approx(0.51, abs=3e-4)


@pytest.mark.parametrize(
    ("words", "low", "high"),
    [
        ("at the center of the bed", (-0.27, -0.34), (0.27, 0.34)),
        ("on the left side of the bed", (-0.75, -0.95), (0.0, 0.95)),
        ("on the right side of the bed", (0.0, -0.95), (0.75, 0.95)),
        ("at the foot of the bed", (-0.75, -0.95), (0.75, -0.28)),
        ("in the front left corner of the bed", (-0.75, -0.95), (-0.45, -0.6)),
        ("on the right edge of the bed", (0.45, -0.95), (0.75, 0.95)),
        ("on the bed near the headboard", (-0.75, 0.2), (0.75, 0.95)),
        ("between the pillows on the bed", (-0.35, 0.3), (0.35, 0.95)),
    ],
)
def test_regions_are_where_a_viewer_at_the_foot_sees_them(words, low, high):
    """The anchor lies in the rectangle that the words mean, and in the polygon that judges the outcome."""
    _, _, found = placed(f"put the ball {words}", thing("tennis ball", ball(0.033)))
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
    _, _, found = placed("put the mug on the table", item)
    mesh = item.mesh.transformed(found.world_from_object)
    low, high = mesh.bounds
    base = ROOM.instances[2].parts[1].box
    apart = np.maximum(low - (base.center + base.half_extents), (base.center - base.half_extents) - high)
    assert apart.max() > 0


def test_too_large_says_so_with_numbers():
    """A thing of 2 m on a table of 0.8 m is too large; footprint and part size are in message and evidence."""
    item = thing("sofa", block((-1.0, -0.45, 0.0), (1.0, 0.45, 0.8)))
    meant = intent(ROOM, item, "put the sofa on the table", None, IntentConfig())
    assert isinstance(meant, Intent)
    turned = rotation(ROOM, item, meant, "", SMALL)
    assert isinstance(turned, Rotation)
    found = anchor(ROOM, item, meant, turned, AnchorConfig())
    assert isinstance(found, Infeasible)
    assert found.reason is Reason.TOO_LARGE_FOR_TARGET
    assert "0.90 x 2.00" in found.message
    assert found.evidence["part_size_m"] == [0.8, 0.8]


def test_full_target_is_too_large_as_well():
    """A bed whose mattress is covered with boxes has no room."""
    things = {
        "bed": ("bed", (0.0, -1.0, 0.0), [("mattress", block((-0.5, -0.5, 0.0), (0.5, 0.5, 0.3)))]),
    }
    for row in range(4):
        for column in range(4):
            low = (-0.48 + 0.25 * row, -0.48 + 0.25 * column, 0.3)
            things[f"box_{row}{column}"] = ("box", None, [("body", block(low, (low[0] + 0.2, low[1] + 0.2, 0.6)))])
    room = segmentation(things)
    item = thing("ball", ball(0.1))
    meant = intent(room, item, "put the ball on the bed", None, IntentConfig())
    assert isinstance(meant, Intent)
    turned = rotation(room, item, meant, "", SMALL)
    assert isinstance(turned, Rotation)
    found = anchor(room, item, meant, turned, AnchorConfig())
    assert isinstance(found, Infeasible)
    assert found.reason is Reason.TOO_LARGE_FOR_TARGET


def test_part_under_a_lid_is_full():
    """A mattress with a board right on it everywhere has no room, and the board is named."""
    room = segmentation(
        {
            "bed": ("bed", None, [("mattress", block((-0.5, -0.5, 0.0), (0.5, 0.5, 0.3)))]),
            "lid": ("box", None, [("body", block((-0.6, -0.6, 0.31), (0.6, 0.6, 0.33)))]),
        }
    )
    item = thing("ball", ball(0.1))
    meant = intent(room, item, "put the ball on the mattress", None, IntentConfig())
    assert isinstance(meant, Intent)
    turned = rotation(room, item, meant, "", SMALL)
    assert isinstance(turned, Rotation)
    found = anchor(room, item, meant, turned, AnchorConfig())
    assert isinstance(found, Infeasible)
    assert found.reason is Reason.TOO_LARGE_FOR_TARGET
    assert found.evidence["in_the_way"] == [{"id": "lid", "name": "box", "share": 1.0}]


def test_no_ray_meets_the_hole_of_a_ring():
    """In the middle of a frame of four boards there is no surface: no_support_hit."""
    rim = [
        block((-0.5, -0.5, 0.0), (0.5, -0.4, 0.3)),
        block((-0.5, 0.4, 0.0), (0.5, 0.5, 0.3)),
        block((-0.5, -0.4, 0.0), (-0.4, 0.4, 0.3)),
        block((0.4, -0.4, 0.0), (0.5, 0.4, 0.3)),
    ]
    room = segmentation({"bench": ("bench", None, [("seat", Mesh.concatenate(rim))])})
    item = thing("ball", ball(0.1))
    meant = intent(room, item, "put the ball in the middle of the bench", None, IntentConfig())
    assert isinstance(meant, Intent)
    turned = rotation(room, item, meant, "", SMALL)
    assert isinstance(turned, Rotation)
    found = anchor(room, item, meant, turned, AnchorConfig())
    assert isinstance(found, Infeasible)
    assert found.reason is Reason.NO_SUPPORT_HIT


def test_shelf_boards_have_headroom():
    """The second board of three is hit although another is above it; a thing higher than the gap does not fit."""
    boards = [("board", block((-0.4, -0.15, 0.4 * k), (0.4, 0.15, 0.4 * k + 0.02))) for k in range(3)]
    room = segmentation({"shelf": ("shelf", (0.0, -1.0, 0.0), boards)})
    _, _, found = placed("put the ball on the second shelf", thing("ball", ball(0.1)), room)
    assert found.part_index == 1
    assert found.surface_point[2] == pytest.approx(0.42)
    tall = thing("vase", block((-0.05, -0.05, 0.0), (0.05, 0.05, 0.39)))
    meant = intent(room, tall, "put the vase on the second shelf", None, IntentConfig())
    assert isinstance(meant, Intent)
    turned = rotation(room, tall, meant, "", SMALL)
    assert isinstance(turned, Rotation)
    assert isinstance(anchor(room, tall, meant, turned, AnchorConfig()), Infeasible)


def test_blanket_on_top_takes_the_object():
    """Where a blanket covers the mattress, the bed means the blanket there."""
    bed = [
        ("mattress", block((-0.75, -0.95, 0.3), (0.75, 0.95, 0.5))),
        ("blanket", block((-0.75, -0.95, 0.501), (0.75, 0.3, 0.55))),
    ]
    room = segmentation({"bed": ("bed", (0.0, -1.0, 0.0), bed)})
    _, _, center = placed("put the ball at the center of the bed", thing("ball", ball(0.1)), room)
    _, _, head = placed("put the ball at the head of the bed", thing("ball", ball(0.1)), room)
    assert (center.part, head.part) == ("blanket", "mattress")


def test_middle_of_the_bed_is_the_beds_not_the_blankets():
    """A blanket on the lower half carries, but "the middle" is that of the whole bed: 0, not -0.5."""
    bed = [
        ("mattress", block((-0.75, -0.95, 0.3), (0.75, 0.95, 0.5))),
        ("blanket", block((-0.75, -0.95, 0.501), (0.75, 0.1, 0.55))),
    ]
    room = segmentation({"bed": ("bed", (0.0, -1.0, 0.0), bed)})
    _, _, found = placed("put the ball in the middle of the bed", thing("tennis ball", ball(0.033)), room)
    _, _, named = placed("put the ball in the middle of the blanket", thing("tennis ball", ball(0.033)), room)
    assert found.part == named.part == "blanket"
    assert found.surface_point[1] == pytest.approx(0.0, abs=0.01)
    assert named.surface_point[1] == pytest.approx(-0.425, abs=0.01)


def test_rug_carries_where_the_floor_is_covered():
    """Under a table that stands on a rug no floor is bare: the ball goes on the rug; elsewhere on the floor."""
    _, _, under = placed("put the ball on the floor under the table", thing("ball", ball(0.1)), HALL)
    _, _, bare = placed("put the ball on the floor next to the bench", thing("ball", ball(0.1)), HALL)
    assert (under.base_id, under.part) == ("rug", "body")
    assert "the rug lies on the floor" in under.reason
    assert np.abs(under.surface_point[:2]).max() < 0.6
    assert bare.base_id == "floor"


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
    _, _, found = placed(f"put the ball on the floor {words}", thing("ball", ball(0.1)), HALL)
    assert (np.array(low) <= found.surface_point[:2]).all()
    assert (found.surface_point[:2] <= np.array(high)).all()


def test_neighbour_says_which_one_is_meant():
    """ "The chair next to the bench" is no place on the chair; "on the chair next to the stove" 3 m away is refused."""
    mug_thing = thing("mug", mug())
    _, _, found = placed("put the mug on the chair next to the bench", mug_thing, HALL)
    assert found.base_id == "chair"
    assert found.region == "center"
    assert "which chair is meant" in found.reason
    meant = intent(HALL, mug_thing, "put the mug on the chair next to the stove", None, IntentConfig())
    assert isinstance(meant, Intent)
    turned = rotation(HALL, mug_thing, meant, "", SMALL)
    assert isinstance(turned, Rotation)
    refused = anchor(HALL, mug_thing, meant, turned, AnchorConfig())
    assert isinstance(refused, Infeasible)
    assert refused.reason is Reason.NO_SUPPORT_HIT


def test_near_a_part_of_two_pieces_is_near_one_of_them():
    """The arms of a sofa are one part; "next to the arm" is at one of its ends, not in the middle between them."""
    arms = Mesh.concatenate([block((x, -0.4, 0.0), (x + 0.2, 0.4, 0.6)) for x in (-1.1, 0.9)])
    parts = [("seat cushion", block((-0.9, -0.4, 0.2), (0.9, 0.4, 0.4))), ("arm", arms)]
    room = segmentation({"sofa": ("sofa", (0.0, -1.0, 0.0), parts)})
    _, _, found = placed("put the ball on the sofa next to the arm", thing("ball", ball(0.1)), room)
    assert 0.9 - 0.15 - 0.2 <= abs(found.surface_point[0]) <= 0.9 - 0.1 + 0.01


def test_full_target_names_what_is_in_the_way():
    """A desk covered with books but for gaps of 5 cm: too large, with the books and the lamp by name."""
    things = {"desk": ("desk", (0.0, -1.0, 0.0), [("top", block((-0.6, -0.3, 0.7), (0.6, 0.3, 0.74)))])}
    for row in range(4):
        low = (-0.6 + 0.25 * row, -0.3, 0.74)
        things[f"book_{row}"] = ("book", None, [("body", block(low, (low[0] + 0.2, 0.3, 0.8)))])
    things["lamp"] = ("table lamp", None, [("base", block((0.4, -0.3, 0.74), (0.6, 0.3, 1.0)))])
    room, item = segmentation(things), thing("bowl", ball(0.1))
    meant = intent(room, item, "put the bowl on the desk", None, IntentConfig())
    assert isinstance(meant, Intent)
    turned = rotation(room, item, meant, "", SMALL)
    assert isinstance(turned, Rotation)
    found = anchor(room, item, meant, turned, AnchorConfig())
    assert isinstance(found, Infeasible)
    assert found.reason is Reason.TOO_LARGE_FOR_TARGET
    assert "in the way: book" in found.message
    assert found.evidence["blocked_share"] == 1.0
    assert {row["id"] for row in found.evidence["in_the_way"]} <= {*things}


def test_stages_are_deterministic():
    """Same input, same anchor, bit for bit."""
    item = thing("mug", mug())
    first, second = (placed("put the mug on the edge of the table", item)[2] for _ in range(2))
    assert np.array_equal(first.world_from_object, second.world_from_object)


# materials ----------------------------------------------------------------------------------------------------------


def test_one_row_per_part_and_the_gigapascal_rule():
    """Object first, then the base; wood is rigid, the mattress is soft, each with a reason."""
    item = thing("mug", mug())
    meant, _, found = placed("put the mug on the bed", item)
    chosen = materials(ROOM, item, meant, found, "", MaterialsConfig())
    assert not isinstance(chosen, Infeasible)
    assert chosen.rows[0].body == "object"
    assert chosen.of("bed", 1).model is Model.MPM
    assert chosen.of("bed", 0).model is Model.RIGID
    assert all(row.reason for row in chosen.rows)
    assert all((row.material.youngs_modulus > 1e9) == (row.model is Model.RIGID) for row in chosen.rows)
    assert "weighs" in chosen.rows[0].reason


def test_paper_limits_are_an_option():
    """Off by default; on, soft foam is clamped to 5e4 Pa and the reason says so."""
    item = thing("ball", ball())
    meant, _, found = placed("put the ball on the bed", item)
    plain = materials(ROOM, item, meant, found, "", MaterialsConfig())
    clamped = materials(ROOM, item, meant, found, "", MaterialsConfig(paper_limits=True))
    assert not isinstance(plain, Infeasible)
    assert not isinstance(clamped, Infeasible)
    assert plain.of("bed", 1).material.youngs_modulus < 5e4
    assert clamped.of("bed", 1).material.youngs_modulus == 5e4
    assert "limits" in clamped.of("bed", 1).reason
    assert (plain.limits, clamped.limits) == ("none", "paper_limits")
    assert "paper's limits" in clamped.notes[0]
    assert plain.notes == ()


def test_materials_hear_the_whole_prompt():
    """What the sentence calls the object and its support made of counts, each for its own."""
    item = thing("mug", mug())
    prompt = "put the steel mug on the glass table"
    meant, _, found = placed(prompt, item)
    chosen = materials(ROOM, item, meant, found, prompt, MaterialsConfig())
    assert isinstance(chosen, PartMaterials)
    top = next(row for row in chosen.rows if row.body == meant.base_id and row.part in ("top", "body"))
    assert (chosen.rows[0].material.id, top.material.id) == ("steel", "glass")
    assert "'glass'" in top.reason
    assert chosen.rows[0].material.source.startswith("density")


@pytest.mark.parametrize(("share", "model"), [(1.4, Model.RIGID), (0.7, Model.MPM)])
def test_what_nobody_would_see_give_is_rigid_if_asked(share, model):
    """On either side of the dent that Hertz predicts for the ball in the mattress; the curvature of a ball of triangles
    is known to a factor of 2.7, so the dent, which goes with its cube root, to 1.4."""
    item = thing("ball", ball(0.1))
    meant, _, found = placed("put the ball on the mattress", item)
    plain = materials(ROOM, item, meant, found, "", MaterialsConfig())
    assert isinstance(plain, PartMaterials)
    foam = plain.of("bed", 1).material
    effective = foam.youngs_modulus / (1.0 - foam.poisson_ratio**2)
    dent = (9.0 * (meant.mass * 9.81) ** 2 / (16.0 * 0.1 * effective**2)) ** (1.0 / 3.0)
    aware = materials(ROOM, item, meant, found, "", MaterialsConfig(load_aware=True, invisible=share * dent))
    assert isinstance(aware, PartMaterials)
    row = aware.of("bed", 1)
    assert row.model is model
    assert ("load-aware" in row.reason) == (model is Model.RIGID)
    assert any("mattress" in note for note in aware.notes) == (model is Model.RIGID)
    assert (plain.of("bed", 1).model, plain.notes) == (Model.MPM, ())


def test_unknown_things_get_a_stated_fallback():
    """Nothing known of name and part: the reason starts with the word fallback."""
    item = thing("zorb", ball())
    meant, _, found = placed("put the zorb on the bed", item)
    chosen = materials(ROOM, item, meant, found, "", MaterialsConfig())
    assert not isinstance(chosen, Infeasible)
    assert chosen.rows[0].reason.startswith("fallback")


def test_configs_survive_json():
    """Every configuration round-trips."""
    model = LanguageConfig(client=ClientName.ANTHROPIC)
    for config in (IntentConfig(), RotationConfig(), AnchorConfig(language=model), MaterialsConfig()):
        assert type(config).model_validate_json(config.model_dump_json()) == config
