"""What many scenes and objects hold: the first two stages of each, from the cache where they are there.

Nothing is placed. A scene that cannot be read is a value, so that the others go on.
"""

import sys
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import partial
from typing import TypeVar

from rich.console import Console

from dcap.language.protocol.session import Session
from dcap.scene.errors import DcapError
from dcap.scene.store.artifacts import Store
from dcap.scene.store.ref import Ref
from dcap.scene.types.sample import Sample
from dcap.scene.types.segmentation import SegmentedObject, SegmentedScene
from flows.place import PlaceConfig
from flows.run_names import scene_tags, shown
from flows.sample_run import recorded
from flows.server import prefect_server
from tasks.mesh.stage import mesh_object_task, mesh_scene_task
from tasks.runner.context import NotCachedError, RunContext
from tasks.segment.stage import segment_object_task, segment_task

RefT = TypeVar("RefT")
AT_A_TIME = 2
"""Scenes that are read side by side: a large scan needs gigabytes."""


@dataclass(frozen=True, slots=True)
class ReadScenes:
    """What was read, by name, and why the others were not."""

    scenes: Mapping[str, Ref[SegmentedScene]]
    objects: Mapping[str, Ref[SegmentedObject]]
    failed: Mapping[str, str]
    """Why, by the name of a scene or object."""


def scene_contents(sample: Sample, config: PlaceConfig) -> Ref[SegmentedScene]:
    """The things of the sample's scene."""
    source = Store.default().add_source(sample.scene)
    scan = mesh_scene_task(source, sample.scene_options, config=config.scene_mesh)
    return segment_task(scan, config=config.segment)


def object_contents(sample: Sample, config: PlaceConfig) -> Ref[SegmentedObject]:
    """The sample's object with its parts."""
    source = Store.default().add_source(sample.object)
    scan = mesh_object_task(source, sample.object_options, config=config.object_mesh)
    return segment_object_task(scan, config=config.segment)


def read_all(
    scenes: Mapping[str, Sample], objects: Mapping[str, Sample], config: PlaceConfig, session: Session, *, quiet: bool
) -> ReadScenes:
    """Read all of them; Prefect starts only where something is not in the cache."""
    failed: dict[str, str] = {}
    found = looked_up(scene_contents, scenes, config, failed)
    items = looked_up(object_contents, objects, config, failed)
    scenes_left, objects_left = ({name: one for name, one in all_of.items() if name not in known and name not in failed}
                                 for all_of, known in ((scenes, found), (objects, items)))  # fmt: skip
    if scenes_left or objects_left:
        console = Console(file=sys.stderr, quiet=quiet, highlight=False, force_jupyter=False)
        with console.status("starting") as status, prefect_server():
            told = partial(tell, status.update, "object", len(objects_left))
            items |= computed(object_contents, objects_left, config, session, failed, told)
            told = partial(tell, status.update, "scene", len(scenes_left))
            found |= computed(scene_contents, scenes_left, config, session, failed, told)
    return ReadScenes(
        {name: found[name] for name in scenes if name in found},
        {name: items[name] for name in objects if name in items},
        failed,
    )


def tell(update: Callable[[str], None], kind: str, count: int, done: int) -> None:
    """Say how far it is."""
    update(f"{kind} {done} of {count}")


def looked_up(
    function: Callable[[Sample, PlaceConfig], RefT],
    samples: Mapping[str, Sample],
    config: PlaceConfig,
    failed: dict[str, str],
) -> dict[str, RefT]:
    """Those that are in the cache; what cannot be read at all is told in `failed`."""
    found = {}
    for name, sample in samples.items():
        try:
            with recorded(sample, RunContext(lookup_only=True)):
                found[name] = function(sample, config)
        except NotCachedError:
            continue
        except DcapError as error:
            failed[name] = " ".join(str(error).split())
    return found


def computed(
    function: Callable[[Sample, PlaceConfig], RefT],
    samples: Mapping[str, Sample],
    config: PlaceConfig,
    session: Session,
    failed: dict[str, str],
    told: Callable[[int], None],
) -> dict[str, RefT]:
    """Those that are not, each in a flow run of its own."""
    from prefect import Flow, tags  # once the server's address is known

    def one(name: str) -> RefT | None:
        sample = samples[name]
        title = shown(f"read / {name}")
        flow = Flow(function, name="read", flow_run_name=lambda: title, validate_parameters=False, persist_result=False)
        try:
            with tags(*scene_tags(sample)), recorded(sample, RunContext(session=replace(session, sample=name))):
                return flow(sample, config)
        except DcapError as error:
            failed[name] = " ".join(str(error).split())
            return None

    found = {}
    with ThreadPoolExecutor(AT_A_TIME) as pool:
        for done, (name, ref) in enumerate(zip(samples, pool.map(one, samples), strict=True), 1):
            told(done)
            if ref is not None:
                found[name] = ref
    return found
