"""The floor plan of a scene, for baselines that plan on boxes, and of other rooms as examples."""

from dcap.evaluation.baselines.floor_plan import floor_plan_of
from dcap.scene.types.floor_plan import FloorPlan, FloorPlans
from dcap.scene.types.segmentation import SegmentedScene
from tasks.cache import stage


def floor_plan(scene: SegmentedScene) -> FloorPlan:
    """Outline and boxes of a scene."""
    return floor_plan_of(scene)


def gathered(plan: FloorPlan, before: FloorPlans | None = None) -> FloorPlans:
    """The plans collected before, and one more."""
    return FloorPlans((*(before.plans if before else ()), plan))


floor_plan_task = stage(floor_plan)
gathered_task = stage(gathered)
