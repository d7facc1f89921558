"""How each method places a sample: DCAP's stages, DCAP's stages with one idea left out, or a baseline's proposal.

Every method gets the same scene, object, scale and mass, and the same stages measure its final meshes. The final pose
of a baseline is not changed.
"""

from collections.abc import Callable, Hashable, Mapping
from dataclasses import replace
from pathlib import Path

from dcap.evaluation.methods import BASELINES, DCAP
from dcap.scene.errors import GeometryError, InputError
from dcap.scene.types.choices import Anchor, Intent
from dcap.scene.types.floor_plan import FloorPlans
from dcap.scene.types.sample import Sample
from dcap.scene.types.segmentation import SegmentedObject, SegmentedScene
from flows.place import FileRefs, PlaceConfig, PlacementRefs, feasible, place
from flows.repeats import coarsened, drift_broke_down
from tasks.anchor.stage import anchor_task
from tasks.artifact import Ref, Store
from tasks.baselines.fireplace import FirePlaceConfig, fireplace_task
from tasks.baselines.planners import (
    HolodeckConfig,
    LayoutGptConfig,
    floor_plan_task,
    gathered_task,
    holodeck_task,
    layoutgpt_task,
)
from tasks.intent.stage import intent_task
from tasks.materials.stage import materials_task
from tasks.measure.drift import drift_task, indentation_task
from tasks.measure.referee import referee_task
from tasks.measure.touch import measure_task
from tasks.mesh.stage import mesh_scene_task
from tasks.overview import overview_task
from tasks.particles.stage import particles_task, proposal_particles_task
from tasks.pointed.stage import point_out_task, point_task
from tasks.posed.stage import posed_task
from tasks.render.stage import render_task
from tasks.rotation.stage import rotation_task
from tasks.segment.stage import segment_task

Examples = tuple[Ref[FloorPlans] | None, tuple[str, ...]]
"""Collected plans, and names of the scenes without one."""
EXAMPLES: dict[Hashable, Examples] = {}
"""Examples collected in this process; for each scene, they take the stages of all other scenes."""
NO_DROP, RIGID_DROP = "no_drop", "rigid_drop"
OTHER_MATERIALS = frozenset({RIGID_DROP, "blended_materials", "paper"})
"""Ablations whose drop uses other materials, or rigid ones only."""
PAPER_STEP_SECONDS = 2e-3 / 18
"""The paper's step of 2 ms in 18 substeps [s]."""
PICTURE = 512
"""Side of the pictures of other methods than DCAP [pixels]; judges see others, which are alike for all."""


def place_by(sample: Sample, config: PlaceConfig) -> PlacementRefs:
    """Place the sample by its method, and measure its final state if the configuration says so."""
    own = config_of(sample.method, config)
    proposes = sample.method in BASELINES or sample.method == NO_DROP
    found = place(sample, own, place_proposal if proposes else None)
    return with_measures(sample, found, config) if config.measured else found


def changed(**stages: Mapping[str, object]) -> Callable[[PlaceConfig], PlaceConfig]:
    """A change of some stages' settings."""

    def change(config: PlaceConfig) -> PlaceConfig:
        new = {name: type(getattr(config, name)).model_validate(dict(getattr(config, name)) | dict(settings))
               for name, settings in stages.items()}  # fmt: skip
        return config.model_copy(update=new)

    return change


def as_in_the_paper(config: PlaceConfig) -> PlaceConfig:
    """Explicit MLS-MPM with the paper's steps and clamps; docs/methods.md says where it differs from the paper."""
    own = {"method": "mls", "mls_step_seconds": PAPER_STEP_SECONDS, "stability": False}
    solver = config.drop.solver.model_copy(update=own)
    drop = config.drop.model_copy(update={"solver": solver})
    return changed(materials={"paper_limits": True})(config).model_copy(update={"drop": drop})


CHANGES: Mapping[str, Callable[[PlaceConfig], PlaceConfig]] = {
    RIGID_DROP: changed(materials={"rigid_above": 1e-3}),
    "no_size_prior": changed(intent={"smallest_scale": 1.0, "largest_scale": 1.0}),
    "no_rotation": changed(rotation={"chosen": False}),
    "no_subpart": changed(anchor={"subparts": False}),
    "face_up": changed(anchor={"face_up": True}),
    "views_12": changed(rotation={"views": 12}),
    "pose_strip": changed(rotation={"pose_strip": True}),
    "blended_materials": changed(materials={"blended": True}),
    "uniform_fill": changed(particles={"uniform": True}),
    "paper": as_in_the_paper,
}
"""Change of the configuration by each ablation."""


def config_of(method: str, config: PlaceConfig) -> PlaceConfig:
    """The configuration of a method."""
    change = CHANGES.get(method)
    own = config if change is None else change(config)
    return own if method == DCAP else changed(render={"size": min(config.render.size, PICTURE)})(own)


def place_proposal(sample: Sample, config: PlaceConfig, read: FileRefs) -> PlacementRefs:
    """A method's proposal as a placement; nothing is simulated."""
    scene, item, pointed = read.scene, read.item, None
    if sample.method == NO_DROP and sample.place is not None:
        pointed = point_task(read.scene_scan, scene, sample.place, sample.prompt)
        scene = point_out_task(scene, pointed)
    intent = intent_task(scene, item, sample.prompt, sample.mass, config=config.intent, pointed=pointed)
    anchor: Ref[Anchor]
    rotation = None
    if sample.method == NO_DROP:
        rotation = rotation_task(scene, item, intent, sample.prompt, config=config.rotation)
        anchor = anchor_task(scene, item, intent, rotation, sample.prompt, config=config.anchor)
    else:
        anchor = proposal(sample, scene, item, intent, config)
    materials = materials_task(scene, item, intent, anchor, sample.prompt, config=config.materials)
    filled = particles_task if sample.method == NO_DROP else proposal_particles_task
    particles = filled(scene, item, intent, anchor, materials, config=config.particles)
    settled = posed_task(item, anchor)
    renders = render_task(scene, item, anchor, settled, read.scene_surface, read.object_surface, config=config.render)
    overview = None
    if renders.infeasible:
        overview = overview_task(scene, item, feasible(intent), feasible(anchor), config=config.overview, filled=False)
    return PlacementRefs(
        scene_scan=read.scene_scan, object_scan=read.object_scan, scene_surface=read.scene_surface,
        object_surface=read.object_surface, scene=scene, item=item, intent=intent, rotation=rotation, anchor=anchor,
        materials=materials, particles=particles, settled=settled, renders=renders, overview=overview,
    )  # fmt: skip


def proposal(
    sample: Sample, scene: Ref[SegmentedScene], item: Ref[SegmentedObject], intent: Ref[Intent], config: PlaceConfig
) -> Ref[Anchor]:
    """Proposal of a baseline; it asks the same model as our anchor stage."""
    language = {"language": config.anchor.language}
    if sample.method == "fireplace":
        return fireplace_task(scene, item, intent, sample.prompt, config=FirePlaceConfig.model_validate(language))
    if sample.method == "holodeck":
        return holodeck_task(scene, item, intent, sample.prompt, config=HolodeckConfig.model_validate(language))
    if sample.method != "layoutgpt":
        raise ValueError(f"no baseline is called {sample.method!r}")
    plans, left_out = examples_of(sample, config)
    asked = LayoutGptConfig.model_validate(language)
    return layoutgpt_task(scene, item, intent, sample.prompt, config=asked, exemplars=plans, left_out=left_out)


def examples_of(sample: Sample, config: PlaceConfig) -> Examples:
    """Plans of the scenes that a method may learn from, and the names of those that cannot be read: an error in another
    scene is reported by the samples in it and does not fail this one. Samples of one scene share them."""
    asked = (Store.default().root, sample.examples, sample.scene_options, config.scene_mesh, config.segment)
    if asked in EXAMPLES:
        return EXAMPLES[asked]
    plans: Ref[FloorPlans] | None = None
    left_out: list[str] = []
    for other in sample.examples:
        try:
            source = Store.default().add_source(other)
            scan = mesh_scene_task(source, sample.scene_options, config=config.scene_mesh, labels=None, scale=None)
            plan = floor_plan_task(segment_task(scan, config=config.segment, labels=None))
        except (InputError, GeometryError):
            left_out.append(Path(other).name)
        else:
            plans = gathered_task(plan, plans)
    if plans is not None and plans.pending:
        return plans, tuple(left_out)
    return EXAMPLES.setdefault(asked, (plans, tuple(left_out)))


def with_measures(sample: Sample, found: PlacementRefs, config: PlaceConfig) -> PlacementRefs:
    """Add the measurements of the final state, if there is one.

    An ablation with other materials is measured with the true ones: a body that is rigid in its drop should have sunk
    in. The drift continues its own simulation, on its own cells, unless it had no soft material at all.
    """
    if found.settled.infeasible:
        return found
    scene, item, anchor, settled = found.scene, found.item, found.anchor, found.settled
    measures = measure_task(scene, item, anchor, settled)
    found = replace(found, measures=measures)
    materials, particles = found.materials, found.particles
    if sample.method in OTHER_MATERIALS:
        materials = materials_task(scene, item, found.intent, anchor, sample.prompt, config=config.materials)
        particles = particles_task(scene, item, found.intent, anchor, materials, config=config.particles)
    if particles.infeasible:
        return found
    sinking = indentation_task(scene, item, found.intent, anchor, materials, particles, settled)
    found = replace(found, indentation=sinking)
    if not config.compared:
        return found
    simulated = particles if sample.method == RIGID_DROP else found.particles
    drift = drift_task(simulated, settled, config=config.drift)
    if drift_broke_down(drift, settled):
        cells = coarsened(config.particles)
        larger = proposal_particles_task(scene, item, found.intent, anchor, materials, config=cells)
        drift = drift if larger.infeasible else drift_task(larger, settled, config=config.drift)
    referee = referee_task(scene, item, anchor, materials, particles, settled, measures)
    return replace(found, drift=drift, referee=referee)
