"""What the settings of the ablations do in their stages: each leaves out its one idea and keeps the rest."""

from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from box_rooms import ROOM, ball, block, mug, segmentation, thing, toy
from stage_chain import PICTURE_SIZE, Asked, Stages

from dcap.geometry.placement.search import SAMPLES
from dcap.knowledge.material_table import load_materials
from dcap.language.offline.client import OfflineClient
from dcap.scene.types.choices import Anchor, Intent, Rotation
from dcap.scene.types.materials import BodyModel, Material, PartMaterials
from dcap.scene.types.mesh import Mesh
from dcap.scene.types.outcome import Infeasible, Reason
from dcap.scene.types.segmentation import Segmentation, SegmentedObject, SegmentedScene
from tasks.anchor.stage import AnchorConfig, anchor
from tasks.intent.stage import IntentConfig
from tasks.materials.stage import MaterialsConfig, materials
from tasks.rotation.stage import RotationConfig, rotation

OFFLINE = Stages()
RADIUS = 0.05
RASTER = 0.5 * np.sqrt(2.0) * 2.0 * RADIUS / SAMPLES
"""Half the diagonal of a cell of the raster on which a ball's spots lie [m]."""
CONSTANTS = ("density", "youngs_modulus", "poisson_ratio", "static_friction", "dynamic_friction")


@cache
def made_of(**settings: object) -> PartMaterials:
    """Materials of a ball on the bed, whose mattress and pillows are soft."""
    item = thing("ball", ball())
    meant, _, found = OFFLINE.placed("put the ball on the bed", item)
    config = MaterialsConfig.model_validate(settings)
    rows = materials(SegmentedScene(ROOM), SegmentedObject(item), meant, found, "", config, OfflineClient())
    assert isinstance(rows, PartMaterials)
    return rows


def test_above_nothing_everything_is_rigid():
    """The rows are the same ones; none is soft any more, while the mattress is so otherwise."""
    usual, rigid = made_of(), made_of(rigid_above=1e-3)
    assert {row.model for row in usual.rows} == {BodyModel.RIGID, BodyModel.MPM}
    assert {row.model for row in rigid.rows} == {BodyModel.RIGID}
    assert [row.material for row in rigid.rows] == [row.material for row in usual.rows]
    assert min(row.youngs_modulus for row in load_materials().values()) > 1e-3


def test_blended_constants_lie_between_the_row_and_its_kind():
    """Each strictly between the chosen row's and the largest or smallest of that kind, and nearer to no other than half
    the way to the mean; kind and name stay, layers go, and so does what is soft."""
    library = load_materials().values()
    for own, mixed in zip(made_of().rows, made_of(blended=True).rows, strict=True):
        others = [row for row in library if row.kind == own.material.kind]
        assert (mixed.material.id, mixed.material.kind, mixed.material.layers) == (
            own.material.id, own.material.kind, None,
        )  # fmt: skip
        for name in CONSTANTS:
            chosen, value = getattr(own.material, name), getattr(mixed.material, name)
            mean = middle(name, others)
            low, high = sorted((chosen, mean))
            assert low < value < high or chosen == pytest.approx(mean)
        assert "blended" in mixed.reason


def middle(name: str, rows: list[Material]) -> float:
    """Mean over rows, of the modulus a geometric one."""
    values = np.array([getattr(row, name) for row in rows])
    return float(np.exp(np.log(values).mean()) if name == "youngs_modulus" else values.mean())


@pytest.mark.parametrize("factor", [0.01, 0.2, 1.0, 6.0, 100.0])
def test_without_a_prior_a_size_is_that_of_the_file(factor: float):
    """Of a mug in centimetres, of a toy mug and of one as large as a house; otherwise all but the first become mugs."""
    mesh = Mesh.of(factor * mug().vertices, mug().faces)
    item = thing("mug", mesh)
    kept = OFFLINE.meant("put the mug on the bed", item, config=IntentConfig(smallest_scale=1.0, largest_scale=1.0))
    usual = OFFLINE.meant("put the mug on the bed", item)
    assert isinstance(kept, Intent)
    assert isinstance(usual, Intent)
    assert kept.scale == 1.0
    assert (usual.scale == 1.0) == (factor == 1.0)
    assert (kept.base_id, kept.object_name, kept.region) == (usual.base_id, usual.object_name, usual.region)


def turned(prompt: str, client: Asked, **settings: object) -> Rotation:
    """The rotation of a toy."""
    item = thing("plush toy", toy())
    meant = OFFLINE.meant(prompt, item)
    assert isinstance(meant, Intent)
    config = RotationConfig.model_validate({"picture_size": PICTURE_SIZE} | settings)
    found = rotation(SegmentedScene(ROOM), SegmentedObject(item), meant, prompt, config, client)
    assert isinstance(found, Rotation)
    return found


def test_without_rotation_the_pose_of_the_file_is_kept_and_nobody_is_asked():
    """Whatever the sentence says of it; otherwise it turns the toy over."""
    asked, prompt = Asked(), "put the plush toy upside down on the bed"
    assert turned(prompt, Asked()).matrix[2, 2] == pytest.approx(-1.0)
    found = turned(prompt, asked, chosen=False)
    np.testing.assert_array_equal(found.matrix, np.eye(3))
    assert (len(asked.requests), len(found.pictures)) == (0, 0)


def test_twelve_pictures_are_four_times_the_three():
    """Twelve are offered, the three that are usual first, and no two alike; each says from where it is seen."""
    usual, more = Asked(), Asked()
    prompt = "put the plush toy on the bed"
    few, many = turned(prompt, usual), turned(prompt, more, views=12)
    shown = [[one.make() for one in asked.requests[0].pictures] for asked in (usual, more)]
    names = [one.name for one in more.requests[0].pictures]
    assert len(set(names)) == 12
    assert names[3] == "the object, flipped by 180 degrees about x, seen from the right"
    assert [len(pictures) for pictures in shown] == [3, 12]
    np.testing.assert_array_equal(shown[0], shown[1][:3])
    assert not any(np.array_equal(shown[1][i], shown[1][k]) for i in range(12) for k in range(i))
    assert replace(more.requests[0], pictures=()) == replace(usual.requests[0], pictures=())
    np.testing.assert_array_equal(few.matrix, many.matrix)
    assert many.pictures == few.pictures == ()  # nobody looked before the answer


def placed(prompt: str, room: Segmentation, **settings: object) -> Anchor | Infeasible:
    """Where a small ball goes."""
    item, client = thing("ball", ball(RADIUS)), OfflineClient()
    meant = OFFLINE.meant(prompt, item, room)
    assert isinstance(meant, Intent)
    pose = OFFLINE.oriented(prompt, item, room)
    config = AnchorConfig.model_validate(settings)
    return anchor(SegmentedScene(room), SegmentedObject(item), meant, pose, prompt, config, client)


@pytest.mark.parametrize(
    "prompt",
    ["put the ball in the front left corner of the bed", "put the ball on the left pillow of the bed",
     "put the ball on the bed near the headboard"],
)  # fmt: skip
def test_without_parts_it_is_the_middle_of_the_whole_support(prompt: str):
    """Whatever part or region is asked for, on what is highest there; otherwise it is elsewhere."""
    found, usual = placed(prompt, ROOM, subparts=False), placed(prompt, ROOM)
    assert isinstance(found, Anchor)
    assert isinstance(usual, Anchor)
    middle = ROOM.instances[ROOM.index_of("bed")].box.center[:2]
    np.testing.assert_allclose(found.surface_point, [*middle, 0.5], atol=RASTER)
    assert (found.base_id, found.part) == ("bed", "mattress")
    assert np.linalg.norm(usual.surface_point[:2] - middle) > 0.2


def ramp(slope_deg: float) -> Segmentation:
    """A floor and a bench whose top slopes."""
    rise = np.tan(np.radians(slope_deg))
    solid = block((-0.4, -0.3, 0.0), (0.4, 0.3, 0.5))
    points = solid.vertices.astype(float)
    points[:, 2] += np.where(points[:, 2] > 0.1, rise * points[:, 0], 0.0)
    return segmentation(
        {
            "bench": ("bench", (0.0, -1.0, 0.0), [("seat", Mesh.of(points, solid.faces))]),
            "floor": ("floor", None, [("floor", block((-3, -3, -0.1), (3, 3, 0.0)))]),
        }
    )


@pytest.mark.parametrize("slope_deg", [0.0, 30.0])
def test_level_faces_alone_carry_no_slope(slope_deg: float):
    """A slope of more than 26 degrees (cosine 0.9) carries otherwise; a level top either way, at the same place."""
    prompt = "put the ball on the bench"
    usual, level = (placed(prompt, ramp(slope_deg), face_up=one) for one in (False, True))
    assert isinstance(usual, Anchor)
    if slope_deg > 26.0:
        assert isinstance(level, Infeasible)
        assert level.reason is Reason.NO_SUPPORT_HIT
        assert level.message == "the seat of bench has no level face"
        return
    assert isinstance(level, Anchor)
    np.testing.assert_array_equal(level.world_from_object, usual.world_from_object)
