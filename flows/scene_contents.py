"""Contents of many scenes and objects: the first two stages of each, from the cache where possible.

Nothing is placed. A scene that cannot be read is reported in the result, and the others go on.
"""

import sys
from collections.abc import Callable, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from functools import partial
from typing import TypeVar

from rich.console import Console

from dcap.language.protocol.session import Session
from dcap.scene.errors import DcapError
from dcap.scene.types.sample import Sample
from dcap.scene.types.segmentation import SegmentedObject, SegmentedScene
from flows.place import PlaceConfig
from flows.sample_run import sample_context
from tasks.artifact import Ref, Store
from tasks.mesh.stage import mesh_object_task, mesh_scene_task
from tasks.run_context import RunContext
from tasks.segment.stage import segment_object_task, segment_task

RefT = TypeVar("RefT")
AT_A_TIME = 2
"""Most scenes that are read in parallel: a large scan needs gigabytes."""


@dataclass(frozen=True, slots=True)
class ReadScenes:
    """Scenes and objects that were read, by name, and the errors of the others."""

    scenes: Mapping[str, Ref[SegmentedScene]]
    objects: Mapping[str, Ref[SegmentedObject]]
    failed: Mapping[str, str]
    """Errors by the name of a scene or object."""


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
    """Read all of them, or find them in the cache."""
    failed: dict[str, str] = {}
    console = Console(file=sys.stderr, quiet=quiet, highlight=False, force_jupyter=False)
    with console.status("reading") as status:
        items = read(object_contents, objects, config, session, failed, partial(tell, status.update, "object"))
        found = read(scene_contents, scenes, config, session, failed, partial(tell, status.update, "scene"))
    return ReadScenes(found, items, failed)


def tell(update: Callable[[str], None], kind: str, done: int, count: int) -> None:
    """Report progress."""
    update(f"{kind} {done} of {count}")


def read(
    function: Callable[[Sample, PlaceConfig], RefT],
    samples: Mapping[str, Sample],
    config: PlaceConfig,
    session: Session,
    failed: dict[str, str],
    progress: Callable[[int, int], None],
) -> dict[str, RefT]:
    """Return the readable samples by name; the errors of the others go into `failed`."""

    def one(name: str) -> RefT | None:
        sample = samples[name]
        try:
            with sample_context(sample, RunContext(session=session)):
                return function(sample, config)
        except DcapError as error:
            failed[name] = " ".join(str(error).split())
            return None

    found = {}
    with ThreadPoolExecutor(AT_A_TIME) as pool:
        for done, (name, ref) in enumerate(zip(samples, pool.map(one, samples), strict=True), 1):
            progress(done, len(samples))
            if ref is not None:
                found[name] = ref
    return found
