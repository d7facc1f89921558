"""`dcap dataset sample`: makes a data set of placements for a folder of scenes and a folder of objects.

In: the folders, how many per scene, a seed. Out: a dataset file, its truth in the same folder, lists of the splits, and
the deformable supports of the scenes as a table and a plot. The files appear whole or not at all.
"""

import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from dcap.evaluation.outcome_table import ExpectedOutcome
from dcap.evaluation.sampling.questions import MOST_SAMPLES, SAMPLES, SampleDraft, SamplesRequest, misread
from dcap.evaluation.sampling.requests import PlacedAsset, chance
from dcap.evaluation.sampling.splits import shares_of, split_scenes
from dcap.evaluation.supports_plot import save_supports_plot, supports_table
from dcap.geometry.placement.poses import front_of
from dcap.geometry.placement.upright import stands_as_read
from dcap.knowledge.kinds import deformable_supports, front_side, prior_of
from dcap.knowledge.lexicon import label_words, thing_of
from dcap.language.connect import Client, connect
from dcap.language.protocol.requests import IntentRequest, ObjectView, vector
from dcap.scene.checks.findings import Findings
from dcap.scene.checks.scene_folder import layout_of
from dcap.scene.errors import BudgetError, InputError, LanguageError
from dcap.scene.readers.scenes.sugar import MESH_SUFFIXES
from dcap.scene.settings import runs_root
from dcap.scene.types.sample import Sample, SourceOptions
from dcap.scene.types.segmentation import Segmentation
from dcap.scene.written_files import draft_folder
from flows.configure import configured, language_options
from flows.options import PlaceOptions
from flows.prepare_sugar import with_sugar
from flows.sample_files import (
    ASSETS,
    TRUTH_FILE,
    SampledRow,
    asset_labels,
    check_free,
    dataset_text,
    lists_of,
    slug,
    truth_text,
)
from flows.scene_contents import read_all
from flows.scene_lists import named_paths, named_scenes
from tasks.artifact import Store
from tasks.intent.rescale import rescale
from tasks.requests.views import instance_views, object_view, room_center

SAMPLES_FILE = "samples.yaml"
SUPPORTS_TABLE, SUPPORTS_PLOT = "supports.csv", "supports.png"
LARGEST_SEED = 1_000_000
"""Upper bound of the seeds of samples, excluded [-]."""
LONGEST_NOUN = 3
"""Most words of a file's name that are used as the object's name [-]."""
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
    check_sampling(sampling)
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
    read = read_all(sources, things, config, session, quiet=quiet)
    left_out = dict(read.failed)
    report_unusable(left_out, sampling.skip, len(found) + len(items))
    store = Store.default()
    views, assets = {}, []
    for name, ref in read.objects.items():
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
    for name, scene_ref in read.scenes.items():
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


def check_sampling(sampling: SamplingOptions) -> None:
    """Raise InputError for numbers out of range."""
    if not 1 <= sampling.per_scene <= MOST_SAMPLES:
        raise InputError(f"--per-scene {sampling.per_scene} is not between 1 and {MOST_SAMPLES}")
    if not 0.0 <= sampling.infeasible < 1.0:
        raise InputError(f"--infeasible {sampling.infeasible:g} is not a share, from 0 to below 1")


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
    rows: list[SampledRow] = []
    misses: dict[str, str] = {}
    for scene in made:
        for draft in scene.drafts:
            truth = draft.truth(scene.request)
            name = id_of(scene.name, draft, truth, {row.id for row in rows})
            seed = int(chance(sampling.seed, name, "seed") * LARGEST_SEED)
            thing, source = items[draft.object], scene.source
            rows.append(
                SampledRow(
                    name, Path(source.scene), Path(thing.object), draft.prompt, seed, truth, source.scene_options,
                    thing.object_options,
                )
            )  # fmt: skip
            asked = IntentRequest(draft.prompt, views[draft.object], scene.request.instances, scene.request.room_center)
            missed = misread(asked, truth, draft.facing_id)
            if missed:
                misses[name] = f"{draft.prompt} {missed}"
    contents = {one.name: [instance.label for instance in one.contents.instances] for one in made}
    texts = {path.name: dataset_text(rows, path.parent), TRUTH_FILE: truth_text(rows)}
    texts[SUPPORTS_TABLE] = supports_table(contents)
    texts.update(lists_of(splits))
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
        infeasible=sum(not row.truth.feasible for row in rows),
        read_back=len(rows) - len(misses),
        splits={name: len(one) for name, one in splits.items()},
        left_out=left_out,
        misses=misses,
    )


def id_of(scene: str, draft: SampleDraft, truth: ExpectedOutcome, taken: set[str]) -> str:
    """A readable, unused id."""
    facing = "facing" if draft.facing_id else ""
    words = [scene, draft.object, truth.base or "absent", *draft.regions, truth.top, facing]
    name = slug("-".join(word for word in words if word))
    number = 2
    while (one := name if number == 2 and name not in taken else f"{name}-{number}") in taken:
        number += 1
    return one
