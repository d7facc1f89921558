"""Values to store about what was asked of an object and why it was refused."""

from dataclasses import replace

import numpy as np
from dented_bed import anchor, scene_of
from numpy.typing import NDArray

from dcap.scene.types.choices import AskedPose
from dcap.scene.types.earlier import Deformation, EarlierPlacements, FreedThings, PlacedThing
from dcap.scene.types.floor_plan import FloorPlan, FloorPlans, PlanBox
from dcap.scene.types.mesh import AlphaMode, MaterialMap, Mesh, Paint, SourceSurface, SurfaceMaterial
from dcap.scene.types.outcome import ObjectHole, OpenObject
from dcap.scene.types.pictures import Renders, Visibility
from dcap.scene.types.settled import PoseCheck


def asked_and_refused() -> tuple[object, ...]:
    """One of each type."""
    hole, up, front = ObjectHole((0.0, 0.1, 0.2), (0.3, 0.2)), np.array([0.0, 0, 1]), np.array([0.0, -1, 0])
    return (
        OpenObject(2, (hole,)), hole, AskedPose("upright", up, None, up, front, "lies"),
        PoseCheck("upright", "on_back", 1.57, 0.78, met=False, doubt="lies"),
    )  # fmt: skip


def painted_records(picture: NDArray[np.uint8]) -> tuple[object, ...]:
    """A textured surface and its paint, pictures and what is seen in them."""
    uv = np.linspace(0.0, 1.0, 6).reshape(1, 3, 2)
    paint = Paint(np.full((1, 3), 200, np.uint8), np.zeros(1, np.int32), uv, (picture,))
    seen = Visibility(np.ones((3, 4)), 0.25)
    renders = Renders(picture, picture, picture, 0.75, np.zeros(3), np.ones(3), picture, picture, picture, seen)
    triangle = Mesh.of(np.eye(3), [[0, 1, 2]])
    part = MaterialMap(1, 1, 0.5)
    said = SurfaceMaterial("glass", AlphaMode.MASK, 0.25, 0.5, 0.0, None, (0.1, 0.2, 0.3), False, normal_map=part)
    clear = np.dstack([picture, picture[..., 0]])
    full = replace(paint, textures=(clear, picture), face_material=np.zeros(1, np.int32), materials=(said,),
                   more_uv=(uv,))  # fmt: skip
    return paint, full, part, said, SourceSurface(triangle, full), SourceSurface.untextured(), seen, renders


def earlier_records() -> tuple[object, ...]:
    """What a scene tells of placements before."""
    thing = PlacedThing("placed_1", 0.4, ("bed",), "put the ball on the bed")
    dent = Deformation("bed", ("placed_1",), Mesh.of(np.eye(3), [[0, 1, 2]]), np.full((3, 3), -0.01))
    known = EarlierPlacements(scene_of().instances, (), (thing,), (("placed_1", "bed"),), (dent,))
    return thing, dent, known, FreedThings(scene_of(), anchor(), (thing,), "bed", (), ("in reach",))


def planned_records() -> tuple[object, ...]:
    """A floor plan with a bed, and several plans."""
    bed = PlanBox("3", -1, "bed", np.array([1.0, 1.0, 0.25]), np.array([1.6, 2.0, 0.5]), 0.3)
    plan = FloorPlan("bedroom", np.array([[0.0, 0.0], [4.0, 0.0], [4.0, 3.0], [0.0, 3.0]]), 0.0, (bed,))
    return bed, plan, FloorPlans((plan, plan))
