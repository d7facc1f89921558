"""One placement, from files and a sentence to pictures of the object at rest: the table of contents of DCAP."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeVar

from pydantic import BaseModel

from dcap.scene.readers.frame import ANY
from dcap.scene.readers.scenes.placed_scene import is_placed_scene
from dcap.scene.types.choices import Anchor, Intent, Rotation
from dcap.scene.types.materials import PartMaterials
from dcap.scene.types.measures import Drift, Indentation, Measures, RefereeMeasures
from dcap.scene.types.mesh import SourceSurface
from dcap.scene.types.particles import Particles
from dcap.scene.types.pictures import Overview, Renders
from dcap.scene.types.sample import Sample
from dcap.scene.types.scan import FileScale, Scan
from dcap.scene.types.segmentation import SegmentedObject, SegmentedScene
from dcap.scene.types.settled import Settled
from flows.repeats import settle
from flows.scene_hints import LabelRefs, given_labels
from tasks.anchor.stage import AnchorConfig, anchor_task
from tasks.artifact import Ref, Source, Store
from tasks.cache import Stage
from tasks.drop.stage import DropConfig, drop_task
from tasks.freed.stage import freed_anchor_task, freed_scene_task, freed_task
from tasks.intent.stage import IntentConfig, intent_task
from tasks.materials.stage import MaterialsConfig, materials_task
from tasks.measure.drift import DriftConfig
from tasks.mesh.stage import (
    MeshConfig,
    mesh_object_task,
    mesh_scene_task,
    surface_object_task,
    surface_scene_task,
    surface_start_task,
)
from tasks.overview import OverviewConfig, overview_task
from tasks.particles.config import ParticlesConfig
from tasks.particles.stage import particles_task
from tasks.pointed.stage import point_out_task, point_task
from tasks.render.config import RenderConfig
from tasks.render.stage import render_task
from tasks.rotation.stage import RotationConfig, rotation_task
from tasks.segment.known_height import found_scale_task
from tasks.segment.stage import SegmentConfig, segment_object_task, segment_task

ValueT = TypeVar("ValueT")


class PlaceConfig(BaseModel, frozen=True, extra="forbid"):
    """One configuration per stage."""

    scene_mesh: MeshConfig = MeshConfig()
    object_mesh: MeshConfig = MeshConfig()
    segment: SegmentConfig = SegmentConfig()
    intent: IntentConfig = IntentConfig()
    rotation: RotationConfig = RotationConfig()
    anchor: AnchorConfig = AnchorConfig()
    materials: MaterialsConfig = MaterialsConfig()
    particles: ParticlesConfig = ParticlesConfig()
    drop: DropConfig = DropConfig()
    render: RenderConfig = RenderConfig()
    overview: OverviewConfig = OverviewConfig()
    drift: DriftConfig = DriftConfig()
    measured: bool = False
    """Whether the final state is measured on its meshes, like those of other methods."""
    compared: bool = False
    """Whether other methods place the sample, too: the simulation is then continued, to measure the drift."""


STAGES: tuple[Stage[..., object], ...] = (
    mesh_scene_task,
    mesh_object_task,
    surface_scene_task,
    surface_object_task,
    segment_task,
    segment_object_task,
    intent_task,
    rotation_task,
    anchor_task,
    materials_task,
    particles_task,
    drop_task,
    render_task,
)
"""The stages of a feasible placement, in the order in which `place` calls them."""


SECTIONS = {
    mesh_scene_task.name: "scene_mesh",
    mesh_object_task.name: "object_mesh",
    segment_object_task.name: "segment",
    found_scale_task.name: "segment",
}
"""Fields of `PlaceConfig` whose names differ from that of their stage."""


@dataclass(frozen=True, slots=True, kw_only=True)
class FileRefs:
    """Results of the stages that read the two files, as references into the store."""

    scene_scan: Ref[Scan]
    object_scan: Ref[Scan]
    scene_surface: Ref[SourceSurface]
    object_surface: Ref[SourceSurface]
    scene: Ref[SegmentedScene]
    """Scene at the start of the drop: without the dents of earlier placed things, which take part again."""
    item: Ref[SegmentedObject]


@dataclass(frozen=True, slots=True, kw_only=True)
class PlacementRefs(FileRefs):
    """Result of each stage."""

    intent: Ref[Intent]
    rotation: Ref[Rotation] | None = None
    """None for a method that chooses it together with the place."""
    anchor: Ref[Anchor]
    materials: Ref[PartMaterials]
    particles: Ref[Particles]
    settled: Ref[Settled]
    renders: Ref[Renders]
    overview: Ref[Overview] | None = None
    """Pictures of an infeasible placement, from what its stages found; None if it is feasible."""
    measures: Ref[Measures] | None = None
    """This and the next three: None if not requested, or without a final state."""
    indentation: Ref[Indentation] | None = None
    drift: Ref[Drift] | None = None
    referee: Ref[RefereeMeasures] | None = None


Proposal = Callable[[Sample, PlaceConfig, FileRefs], PlacementRefs]
"""Proposal of a method that drops nothing, for a scene and an object that were read."""


@dataclass(frozen=True, slots=True, kw_only=True)
class SceneRefs:
    """Results of the stages for a scene alone."""

    scan: Ref[Scan]
    scene: Ref[SegmentedScene]
    surface: Ref[SourceSurface]


def scene_of(sample: Sample, config: PlaceConfig) -> SceneRefs:
    """The sample's scene and the things in it, with nothing placed."""
    labels = given_labels(sample.labels)
    source, options = Store.default().add_source(sample.scene), sample.scene_options
    scale = scale_of(sample, source, labels, config)
    scan = mesh_scene_task(source, options, config=config.scene_mesh, labels=labels.vertices, scale=scale)
    scene = segment_task(scan, config=config.segment, labels=labels.things)
    return SceneRefs(scan=scan, scene=scene, surface=surface_scene_task(source, scan))


def place(sample: Sample, config: PlaceConfig, proposal: Proposal | None = None) -> PlacementRefs:
    """Place the sample's object in its scene as its prompt says; or as a proposal does, once both files are read."""
    labels = given_labels(sample.labels)
    scene_source, object_source = Store.default().add_source(sample.scene), Store.default().add_source(sample.object)

    scale = scale_of(sample, scene_source, labels, config)
    scene_scan = mesh_scene_task(
        scene_source, sample.scene_options, config=config.scene_mesh, labels=labels.vertices, scale=scale
    )
    object_scan = mesh_object_task(object_source, sample.object_options, config=config.object_mesh)
    scene_surface = surface_scene_task(scene_source, scene_scan)
    object_surface = surface_object_task(object_source, object_scan)
    scene = segment_task(scene_scan, config=config.segment, labels=labels.things)
    item = segment_object_task(object_scan, config=config.segment)
    if proposal is not None:
        read = FileRefs(
            scene_scan=scene_scan, object_scan=object_scan, scene_surface=scene_surface,
            object_surface=object_surface, scene=scene, item=item,
        )  # fmt: skip
        return proposal(sample, config, read)

    pointed = None
    if sample.place is not None:
        pointed = point_task(scene_scan, scene, sample.place, sample.prompt)
        scene = point_out_task(scene, pointed)
    intent = intent_task(scene, item, sample.prompt, sample.mass, config=config.intent, pointed=pointed)
    rotation = rotation_task(scene, item, intent, sample.prompt, config=config.rotation)
    anchor = anchor_task(scene, item, intent, rotation, sample.prompt, config=config.anchor)
    given, freed = scene, None
    if is_placed_scene(Path(sample.scene)):  # earlier placed things take part, lifted out of their dents
        freed = freed_task(scene_scan, scene, item, anchor)
        scene, anchor = freed_scene_task(freed), freed_anchor_task(freed)
    materials = materials_task(scene, item, intent, anchor, sample.prompt, config=config.materials, freed=freed)
    particles, settled = settle(
        scene, item, intent, anchor, materials, sample.seed, freed=freed, cells=config.particles, drop=config.drop
    )
    start, before, before_surface = scene_surface, None, None
    if freed is not None:
        start, before, before_surface = surface_start_task(scene_surface, given, scene), given, scene_surface
    renders = render_task(scene, item, anchor, settled, start, object_surface, config=config.render,
                          before=before, before_surface=before_surface)  # fmt: skip
    overview = None
    if renders.infeasible:
        filled = not particles.infeasible
        overview = overview_task(given, item, feasible(intent), feasible(anchor), config=config.overview, filled=filled)

    return PlacementRefs(
        scene_scan=scene_scan,
        object_scan=object_scan,
        scene_surface=scene_surface if settled.infeasible else start,
        object_surface=object_surface,
        scene=given if settled.infeasible else scene,
        item=item,
        intent=intent,
        rotation=rotation,
        anchor=anchor,
        materials=materials,
        particles=particles,
        settled=settled,
        renders=renders,
        overview=overview,
    )


def scale_of(sample: Sample, source: Ref[Source], labels: LabelRefs, config: PlaceConfig) -> Ref[FileScale] | None:
    """The scene's scale from the known height of a thing, which is searched at a guessed scale; None without a
    height."""
    if sample.known_height is None:
        return None
    options = replace(sample.scene_options, unit=ANY)
    guess = mesh_scene_task(source, options, config=config.scene_mesh, labels=labels.vertices)
    return found_scale_task(guess, sample.known_height, config=config.segment, labels=labels.things)


def feasible(ref: Ref[ValueT]) -> Ref[ValueT] | None:
    """The reference, None if it names the reason why there is no value."""
    return None if ref.infeasible else ref
