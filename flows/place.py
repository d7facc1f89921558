"""One placement, from files and a sentence to pictures of the object at rest: the table of contents of DCAP."""

from dataclasses import dataclass

from pydantic import BaseModel

from dcap.scene.readers.frame import Role
from dcap.scene.store.artifacts import Ref, Store
from dcap.scene.types.outcome import Infeasible
from dcap.scene.types.sample import Sample
from tasks.anchor.stage import AnchorConfig, anchor_task
from tasks.drop.stage import DropConfig, drop_task
from tasks.intent.stage import IntentConfig, intent_task
from tasks.materials.stage import MaterialsConfig, materials_task
from tasks.mesh.stage import MeshConfig, mesh_task
from tasks.overview import OverviewConfig, overview_task
from tasks.particles.scenario import ParticlesConfig
from tasks.particles.stage import particles_task
from tasks.render.stage import RenderConfig, render_task
from tasks.rotation.stage import RotationConfig, rotation_task
from tasks.segment.stage import SegmentConfig, segment_object_task, segment_task


class PlaceConfig(BaseModel, frozen=True, extra="forbid"):
    """One configuration per stage."""

    scene_mesh: MeshConfig = MeshConfig(role=Role.SCENE)
    object_mesh: MeshConfig = MeshConfig(role=Role.OBJECT)
    segment: SegmentConfig = SegmentConfig()
    intent: IntentConfig = IntentConfig()
    rotation: RotationConfig = RotationConfig()
    anchor: AnchorConfig = AnchorConfig()
    materials: MaterialsConfig = MaterialsConfig()
    particles: ParticlesConfig = ParticlesConfig()
    drop: DropConfig = DropConfig()
    render: RenderConfig = RenderConfig()
    overview: OverviewConfig = OverviewConfig()


@dataclass(frozen=True, slots=True)
class Placement:
    """What each stage returned, as references into the store."""

    scene_scan: Ref
    object_scan: Ref
    scene: Ref
    item: Ref
    intent: Ref
    rotation: Ref
    anchor: Ref
    materials: Ref
    particles: Ref
    settled: Ref
    renders: Ref


def overlook(placement: Placement, config: PlaceConfig) -> Ref | None:
    """Pictures of an infeasible placement, from what its stages found; None if it is feasible."""
    if placement.renders.kind != Infeasible.__name__:
        return None
    intent, anchor = (ref if ref.kind != Infeasible.__name__ else None for ref in (placement.intent, placement.anchor))
    return overview_task(placement.scene, placement.item, intent, anchor, config=config.overview)


def place(sample: Sample, config: PlaceConfig) -> Placement:
    """Place the sample's object in its scene as its prompt says."""
    scene_source, object_source = Store.default().add_source(sample.scene), Store.default().add_source(sample.object)

    scene_scan = mesh_task(scene_source, sample.scene_options, config=config.scene_mesh)
    object_scan = mesh_task(object_source, sample.object_options, config=config.object_mesh)
    scene = segment_task(scene_scan, config=config.segment)
    item = segment_object_task(object_scan, config=config.segment)
    intent = intent_task(scene, item, sample.prompt, sample.mass, config=config.intent)
    rotation = rotation_task(scene, item, intent, sample.prompt, config=config.rotation)
    anchor = anchor_task(scene, item, intent, rotation, sample.prompt, config=config.anchor)
    materials = materials_task(scene, item, intent, anchor, sample.prompt, config=config.materials)
    particles = particles_task(scene, item, intent, anchor, materials, config=config.particles)
    settled = drop_task(particles, anchor, intent, sample.seed, config=config.drop)
    renders = render_task(scene, item, anchor, settled, config=config.render)

    return Placement(
        scene_scan, object_scan, scene, item, intent, rotation, anchor, materials, particles, settled, renders
    )
