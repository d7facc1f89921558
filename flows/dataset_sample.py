"""`dcap dataset sample`: makes a data set of placements for a folder of scenes and a folder of objects.

In: the folders, how many per scene, a seed. Out: a dataset file, its truth in the same folder, lists of the splits, and
the deformable supports of the scenes as a table and a plot. The files appear whole or not at all.
"""

import os
import sys
from collections.abc import Callable, Collection, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TypeVar

import numpy as np
from rich.console import Console
from rich.status import Status

from dcap.evaluation.outcome_table import ExpectedOutcome
from dcap.evaluation.sampling.questions import MOST_SAMPLES, SAMPLES, SampleDraft, SamplesRequest, misread
from dcap.evaluation.sampling.requests import PlacedAsset, chance
from dcap.evaluation.supports_plot import save_supports_plot, supports_table
from dcap.geometry.placement.poses import front_of
from dcap.geometry.placement.upright import stands_as_read
from dcap.knowledge.kinds import deformable_supports, front_side, prior_of
from dcap.knowledge.lexicon import label_words, thing_of
from dcap.language.connect import Client, connect
from dcap.language.protocol.requests import IntentRequest, ObjectView, vector
from dcap.language.protocol.session import Session
from dcap.scene.checks.findings import Findings
from dcap.scene.checks.scene_folder import layout_of
from dcap.scene.errors import BudgetError, DcapError, InputError, LanguageError
from dcap.scene.readers.scenes.sugar import MESH_SUFFIXES
from dcap.scene.settings import runs_root
from dcap.scene.types.sample import Sample, SourceOptions
from dcap.scene.types.segmentation import Segmentation, SegmentedObject, SegmentedScene
from dcap.scene.written_files import draft_folder
from flows.configure import configured, language_options
from flows.options import PlaceOptions
from flows.place import PlaceConfig
from flows.prepare_sugar import with_sugar
from flows.sample_files import (
    ASSETS,
    TRUTH_FILE,
    asset_labels,
    check_free,
    dataset_text,
    slug,
    truth_text,
)
from flows.sample_run import sample_context
from flows.selection import SPLIT_SUFFIX, named_paths, named_scenes, shares_of, split_scenes
from tasks.artifact import Ref, Store
from tasks.intent.rescale import rescale
from tasks.mesh.stage import mesh_object_task, mesh_scene_task
from tasks.requests.views import instance_views, object_view, room_center
from tasks.run_context import RunContext
from tasks.segment.stage import segment_object_task, segment_task

SAMPLES_FILE = "samples.yaml"
SUPPORTS_TABLE, SUPPORTS_PLOT = "supports.csv", "supports.png"
LARGEST_SEED = 1_000_000
"""Upper bound of the seeds of samples, excluded [-]."""
LONGEST_NOUN = 3
"""Most words of a file's name that are used as the object's name [-]."""
RefT = TypeVar("RefT")
AT_A_TIME = 2
"""Most scenes that are read in parallel: a large scan needs gigabytes."""
TOLD = 3
"""Most left-out items that one line names [-]."""


@dataclass(frozen=True, slots=True)
class SamplingOptions:
    """How to sample a data set."""

    per_scene: int
    seed: int = 0
    infeasible: float = 0.1
    """Share of samples that ought to be refused [-]."""
    splits: str = ""
    scenes: str = ""
    skip: bool = False
    """Leave unusable scenes and objects out."""
    sugar: Path | None = None
    """Folder of SuGaR, which reconstructs meshes for splat-only scenes; None: dcap extracts their surface itself."""


@dataclass(frozen=True, slots=True)
class SampledDataset:
    """A sampled data set."""

    path: str
    scenes: int
    samples: int
    infeasible: int
    """Samples that ought to be refused."""
    read_back: int
    """Sentences that the embedded reader understands as they were meant."""
    splits: Mapping[str, int]
    """Number of scenes by split."""
    left_out: Mapping[str, str] = field(default_factory=dict)
    """Scenes and objects that were not used, and why."""
    misses: Mapping[str, str] = field(default_factory=dict)
    """Readings of the other sentences by the embedded reader, by sample."""


@dataclass(frozen=True, slots=True)
class SampledScene:
    """A scene and its samples."""

    name: str
    source: Sample
    """Its path, and how to read it."""
    contents: Segmentation
    request: SamplesRequest
    """Request for its samples."""
    drafts: tuple[SampleDraft, ...]


def sample_dataset(
    scenes: Path, objects: Path, out: Path | None, sampling: SamplingOptions, options: PlaceOptions, *, quiet: bool
) -> SampledDataset:
    """Sample a data set; InputError for an unusable scene or object, unless `sampling.skip`."""
    if not 1 <= sampling.per_scene <= MOST_SAMPLES:
        raise InputError(f"--per-scene {sampling.per_scene} is not between 1 and {MOST_SAMPLES}")
    if not 0.0 <= sampling.infeasible < 1.0:
        raise InputError(f"--infeasible {sampling.infeasible:g} is not a share, from 0 to below 1")
    shares = shares_of(sampling.splits) if sampling.splits else {}
    found, items = chosen_scenes(scenes, sampling.scenes), found_objects(objects)
    called = asset_labels(objects if objects.is_dir() else objects.parent, items.values())
    path = out or runs_root() / "samples" / slug(scenes.resolve().name) / SAMPLES_FILE
    check_free(path)
    asking = language_options(options)
    config, session = configured(options, language=asking.config()), asking.session(path.parent)
    sources = {name: sample_for(name, one, "", options) for name, one in found.items()}
    if sampling.sugar is not None:
        sources = with_sugar(sources, sampling.sugar, threads=options.threads, quiet=quiet)
    things = {name: sample_for(name, "", one, options, called.get(one, "")) for name, one in items.items()}
    left_out: dict[str, str] = {}
    with Console(file=sys.stderr, quiet=quiet, highlight=False, force_jupyter=False).status("reading") as status:
        read_items = read_all("objects", object_contents, things, config, session, left_out, status)
        read_scenes = read_all("scenes", scene_contents, sources, config, session, left_out, status)
    report_unusable(left_out, sampling.skip, len(found) + len(items))
    store = Store.default()
    views, assets = {}, []
    for name, ref in read_items.items():
        item = store.load(ref)
        assert isinstance(item, Segmentation)
        asset = asset_of(name, item)
        if asset is None:
            told = f"rename the file, or give its category in {ASSETS}"
            left_out[name] = f"the lexicon does not know what {item.instances[0].label!r} is; {told}"
            continue
        views[name] = object_view(item)
        assets.append(asset)
    if not assets:
        raise InputError(f"{objects}: no object that the lexicon can classify; name the files: mug.glb, red_ball.obj")
    client = connect(config.intent.language, session)
    made, short = [], {}
    for name, scene_ref in read_scenes.items():
        contents = store.load(scene_ref)
        assert isinstance(contents, Segmentation)
        try:
            request = samples_request(name, contents, assets, sampling)
            drafts = drafts_for(request, client)
        except BudgetError:
            raise
        except (InputError, LanguageError) as poor:
            short[name] = " ".join(str(poor).split())
            continue
        made.append(SampledScene(name, sources[name], contents, request, drafts))
    report_unusable(short, sampling.skip, len(found))
    left_out.update(short)
    if not made:
        raise InputError(f"{scenes}: no scene is left; the first: {next(iter(left_out.values()), 'none')}")
    return write_dataset(path, made, things, views, sampling, shares, left_out)


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
    kind: str,
    read: Callable[[Sample, PlaceConfig], RefT],
    samples: Mapping[str, Sample],
    config: PlaceConfig,
    session: Session,
    failed: dict[str, str],
    status: Status,
) -> dict[str, RefT]:
    """Return the readable ones by name, from the cache where possible; the errors of the others go into `failed`."""

    def one(name: str) -> RefT | None:
        try:
            with sample_context(samples[name], RunContext(session=session)):
                return read(samples[name], config)
        except DcapError as error:
            failed[name] = " ".join(str(error).split())
            return None

    found: dict[str, RefT] = {}
    with ThreadPoolExecutor(AT_A_TIME) as pool:
        for done, (name, ref) in enumerate(zip(samples, pool.map(one, samples), strict=True), 1):
            status.update(f"{kind}: read {done} of {len(samples)}")
            if ref is not None:
                found[name] = ref
    return found


def report_unusable(bad: Mapping[str, str], skip: bool, count: int) -> None:
    """Raise InputError if scenes or objects are unusable and must not be left out."""
    if not bad or skip:
        return
    first = next(iter(bad.values()))
    if len(bad) == 1 and count == 1:
        raise InputError(first)
    others = list(bad)[1 : 1 + TOLD]
    also = f" (also {', '.join(others)}{' ...' if len(bad) > 1 + TOLD else ''})" if others else ""
    raise InputError(f"{len(bad)} of {count} cannot be used: {first}{also}; --skip leaves such out")


def chosen_scenes(folder: Path, listed: str) -> dict[str, Path]:
    """Scenes below a folder that a list names, by name; InputError where there are none."""
    if not folder.exists():
        raise InputError(f"{folder}: no such file or folder")
    findings = Findings()
    layout = layout_of(folder, findings)
    paths = sorted([*layout.scenes, *layout.meshes])
    if not paths:
        raise InputError(f"{folder}: no scene in this folder: neither labels.json nor {', '.join(MESH_SUFFIXES)}")
    names = {scene_name(one, folder, paths): one for one in paths}
    wanted = named_scenes(listed, folder)
    chosen = named_paths([str(one) for one in paths], wanted)
    return {name: one for name, one in names.items() if not wanted or str(one) in chosen}


def scene_name(path: Path, folder: Path, paths: Sequence[Path]) -> str:
    """Its path in the folder, without a suffix where no other scene has that name."""
    own = path.relative_to(folder) if path != folder else Path(path.resolve().name)
    bare = own if path.is_dir() else own.with_suffix("")
    alike = sum(path.is_file() and one.is_file() and one.with_suffix("") == path.with_suffix("") for one in paths)
    return (own if alike > 1 else bare).as_posix()


def found_objects(folder: Path) -> dict[str, Path]:
    """The meshes of a folder, or the one mesh that it is, by file name without suffix."""
    if not folder.exists():
        raise InputError(f"--objects {folder}: no such file or folder")
    files = [folder] if folder.is_file() else sorted(one for one in folder.rglob("*") if one.is_file())
    meshes = [one for one in files if one.suffix.lower() in MESH_SUFFIXES]
    if not meshes:
        raise InputError(f"--objects {folder}: no mesh there: {', '.join(MESH_SUFFIXES)}")
    found: dict[str, Path] = {}
    for one in meshes:
        if one.stem in found:
            raise InputError(f"--objects {folder}: {found[one.stem].name} and {one.name} have one name; rename one")
        found[one.stem] = one
    return found


def sample_for(name: str, scene: Path | str, thing: Path | str, options: PlaceOptions, label: str = "") -> Sample:
    """A scene or an object as the stages take it."""
    return Sample(
        id=name,
        scene=str(scene),
        object=str(thing),
        prompt="",
        scene_options=SourceOptions(options.up, options.unit),
        object_options=SourceOptions(options.object_up, options.object_unit, label),
    )


def asset_of(name: str, item: Segmentation) -> PlacedAsset | None:
    """An object in the size in which it would be placed; None if the lexicon does not know its kind."""
    label, extents = item.instances[0].label, np.ptp(item.mesh.bounds, axis=0)
    thing = thing_of(label)
    if thing is None:
        return None
    view = object_view(item)
    prior = prior_of("", label, view.size)
    fit = rescale(np.array(prior.sizes), extents, prior.spread, (1e-3, 1e3), item.unit_source)
    words = label_words(label)
    noun = " ".join(words) if len(words) <= LONGEST_NOUN else thing.id
    front, told = front_of(item.mesh, front_side(label))
    told = told and stands_as_read(item.mesh)
    return PlacedAsset(
        name, noun, thing.id, vector(extents * fit.scale), (float(front[0]), float(front[1])) if told else None
    )


def samples_request(
    name: str, contents: Segmentation, assets: Sequence[PlacedAsset], sampling: SamplingOptions
) -> SamplesRequest:
    """Request for the samples of one scene. The share of infeasible ones holds on average: each scene rounds
    randomly."""
    refused = int(sampling.per_scene * sampling.infeasible + chance(sampling.seed, name, "infeasible"))
    return SamplesRequest(
        scene=name,
        instances=instance_views(contents),
        room_center=vector(room_center(contents)),
        assets=tuple(assets),
        count=sampling.per_scene,
        infeasible=min(refused, sampling.per_scene),
        seed=sampling.seed,
    )


def drafts_for(request: SamplesRequest, client: Client) -> tuple[SampleDraft, ...]:
    """Samples of one scene; InputError where they cannot be made."""
    try:
        return client.ask(SAMPLES, request).samples
    except ValueError as error:
        raise InputError(f"{request.scene}: {error}") from error


def write_dataset(
    path: Path,
    made: Sequence[SampledScene],
    items: Mapping[str, Sample],
    views: Mapping[str, ObjectView],
    sampling: SamplingOptions,
    shares: Mapping[str, float],
    left_out: Mapping[str, str],
) -> SampledDataset:
    """Write all files into one folder. Returns a summary of them."""
    splits = split_scenes([one.name for one in made], shares, sampling.seed) if shares else {}
    rows: list[Sample] = []
    truths: dict[str, ExpectedOutcome] = {}
    misses: dict[str, str] = {}
    for scene in made:
        for draft in scene.drafts:
            truth = draft.truth(scene.request)
            name = id_of(scene.name, draft, truth, truths)
            seed = int(chance(sampling.seed, name, "seed") * LARGEST_SEED)
            thing = items[draft.object]
            asked = replace(scene.source, object=thing.object, object_options=thing.object_options)
            rows.append(replace(asked, id=name, prompt=draft.prompt, seed=seed))
            truths[name] = truth
            about = scene.request
            read = IntentRequest(draft.prompt, views[draft.object], about.instances, about.room_center)
            if missed := misread(read, truth, draft.facing_id):
                misses[name] = f"{draft.prompt} {missed}"
    contents = {one.name: [instance.label for instance in one.contents.instances] for one in made}
    texts = {path.name: dataset_text(rows, path.parent), TRUTH_FILE: truth_text(truths)}
    texts[SUPPORTS_TABLE] = supports_table(contents)
    texts.update({f"{name}{SPLIT_SUFFIX}": "\n".join(scenes) + "\n" for name, scenes in splits.items()})
    with draft_folder(path.parent) as folder:
        for file, text in texts.items():
            (folder / file).write_text(text, encoding="utf-8")
        save_supports_plot([deformable_supports(labels) for labels in contents.values()], folder / SUPPORTS_PLOT)
        for file in (*texts, SUPPORTS_PLOT):
            os.replace(folder / file, path.parent / file)
    return SampledDataset(
        path=str(path),
        scenes=len(made),
        samples=len(rows),
        infeasible=sum(not one.feasible for one in truths.values()),
        read_back=len(rows) - len(misses),
        splits={name: len(one) for name, one in splits.items()},
        left_out=left_out,
        misses=misses,
    )


def id_of(scene: str, draft: SampleDraft, truth: ExpectedOutcome, taken: Collection[str]) -> str:
    """A readable, unused id."""
    facing = "facing" if draft.facing_id else ""
    words = [scene, draft.object, truth.base or "absent", *draft.regions, truth.top, facing]
    name = slug("-".join(word for word in words if word))
    number = 2
    while (one := name if number == 2 and name not in taken else f"{name}-{number}") in taken:
        number += 1
    return one
