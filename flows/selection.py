"""Chooses samples of a data set: by scenes, by number, or those that failed in the last run.

A scene is named by its path below the folder that all scenes share, or else by the end of its path, with or without its
suffix: `bedroom_01`, `house_2/kitchen`. An exact path wins over an end: `kitchen` is not `house_2/kitchen` if both
exist. A file has one name per line; `#` starts a comment. `val` means `val.txt` next to the data set, if there is one.

No scene is in two splits of a data set. The draw depends on the names of the scenes and the seed, not on their order.
"""

import os
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from math import isfinite
from pathlib import Path, PurePosixPath
from typing import Any

from dcap.evaluation.methods import by_method, split_id, with_examples
from dcap.evaluation.outcome_table import ExpectedOutcome, read_truth
from dcap.evaluation.run_folder import sample_folder
from dcap.evaluation.sampling.requests import chance
from dcap.scene.errors import InputError
from dcap.scene.readers.scenes.sugar import MESH_SUFFIXES
from dcap.scene.settings import data_root, runs_root
from dcap.scene.text import did_you_mean, first_of
from dcap.scene.types.sample import Sample
from flows.display import print_lines
from flows.find_run import RUN, read_request
from flows.place import PlaceConfig
from flows.prepare_sugar import with_sugar
from flows.run_files import UNFINISHED, read_result
from flows.sample_run import plan_sample
from flows.samples import EMBEDDED, SPLAT_ROOMS, TRUTH, load_samples, load_yaml

DATASET_SEED = 0
SPLATS = 500_000
"""Gaussians per room of the embedded splat dataset, as many as in a scene of InteriorGS."""
SPLIT_SUFFIX = ".txt"
SHOWN = 5
"""Most scenes or ids that a line names."""
NAME = re.compile(r"[A-Za-z][A-Za-z0-9_-]*")
ROUNDING = 1e-6
"""Tolerance of the sum of shares [-]."""


@dataclass(frozen=True, slots=True)
class Selection:
    """Choice of samples from a dataset."""

    limit: int | None = None
    spread: bool = False
    """Whether a limit picks samples that differ as much as possible, rather than the first ones."""
    scenes: str = ""
    only_failed: bool = False
    sugar: Path | None = None
    """Folder of SuGaR, which reconstructs meshes for scenes that only have splats."""


def dataset_samples(dataset: Path | None, methods: Sequence[str], selection: Selection) -> tuple[Path, list[Sample]]:
    """The dataset's file and the selected samples, one per method. The embedded rooms are generated if they are
    missing."""
    path = dataset or EMBEDDED
    if path.resolve() == EMBEDDED:
        ensure_dataset(data_root(), DATASET_SEED)
    elif path.resolve() == SPLAT_ROOMS:
        rooms = [Path(sample.scene).name for sample in load_samples(path)]
        ensure_dataset(data_root(), DATASET_SEED, rooms=list(dict.fromkeys(rooms)), splats=SPLATS)
    every = load_samples(path)
    chosen = of_scenes(every, selection.scenes, path.parent)
    if selection.spread:
        chosen = spread_samples(chosen, truths_of(path, chosen), selection.limit)
    chosen = chosen[: selection.limit]
    if selection.sugar is not None:
        every = sugar_samples(every, selection.sugar)
        chosen = [one for one in every if one.id in {two.id for two in chosen}]
    return path, with_examples([by_method(sample, method) for sample in chosen for method in methods], every)


def sugar_samples(samples: Sequence[Sample], sugar: Path) -> list[Sample]:
    """Samples whose splat-only scenes are replaced by meshes from SuGaR."""
    meshed = with_sugar({one.scene: one for one in samples}, sugar, threads=0, quiet=False)
    return [
        replace(one, scene=meshed[one.scene].scene, scene_options=meshed[one.scene].scene_options) for one in samples
    ]


def ensure_dataset(folder: Path, seed: int, *, rooms: Sequence[str] = (), splats: int = 0, scenes: int = 0) -> Path:
    """Generate the embedded rooms and objects that are missing or incomplete."""
    from dcap.synthetic.dataset import make_dataset

    make_dataset(folder, seed, rooms=rooms, splats=splats, scenes=scenes)
    return folder


def truths_of(dataset: Path, samples: Sequence[Sample]) -> list[ExpectedOutcome | None]:
    """Intended outcomes from the dataset's folder, None where there are none."""
    path = dataset.parent / TRUTH
    known = read_truth(load_yaml(path), str(path)) if path.is_file() else {}
    return [known.get(split_id(sample.id)[1]) for sample in samples]


def named_scenes(text: str, folder: Path) -> tuple[str, ...]:
    """Names in a comma-separated list; splits in `folder` and files are replaced by the names in them."""
    words = [word.strip() for word in text.split(",") if word.strip()]
    if text and not words:
        raise InputError(f"--scenes {text!r} names no scene")
    names: list[str] = []
    for word in words:
        split, file = folder / f"{word}{SPLIT_SUFFIX}", Path(word)
        listed = split if split.is_file() else file if file.suffix == SPLIT_SUFFIX else None
        names += [word] if listed is None else names_in(listed)
    return tuple(dict.fromkeys(names))


def names_in(file: Path) -> list[str]:
    """The names in a file; InputError if there are none."""
    try:
        lines = [line.partition("#")[0].strip() for line in file.read_text(encoding="utf-8").splitlines()]
    except (OSError, UnicodeDecodeError) as broken:
        raise InputError(f"--scenes {file}: cannot be read: {getattr(broken, 'strerror', '') or broken}") from None
    names = [line for line in lines if line]
    if not names:
        raise InputError(f"--scenes {file}: names no scene")
    return names


def spellings(path: str) -> tuple[PurePosixPath, ...]:
    """A scene's path, also without its suffix if that is one of scene files."""
    whole = PurePosixPath(Path(path).as_posix())
    return (whole, whole.with_suffix("")) if whole.suffix.lower() in MESH_SUFFIXES else (whole,)


def with_name(paths: Sequence[str], name: str) -> set[str]:
    """Paths that match a name."""
    shared = os.path.commonpath([os.path.dirname(os.path.abspath(path)) for path in paths])
    exact = PurePosixPath(Path(shared, name).as_posix())
    below = {path for path in paths if exact in spellings(os.path.abspath(path))}
    wanted = PurePosixPath(name).parts
    ends = {path for path in paths if any(one.parts[-len(wanted) :] == wanted for one in spellings(path) if wanted)}
    return below or ends


def named_paths(paths: Sequence[str], names: Sequence[str]) -> set[str]:
    """Paths that match any of the names; InputError for a name without a match."""
    chosen: set[str] = set()
    for name in names:
        meant = with_name(paths, name)
        if not meant:
            known = sorted({Path(path).stem for path in paths})
            others = f"; there are {first_of(known, SHOWN)}"
            raise InputError(f"--scenes: no scene is named {name!r}{did_you_mean(name, known) or others}")
        chosen |= meant
    return chosen


def of_scenes(samples: Sequence[Sample], text: str, folder: Path) -> list[Sample]:
    """Samples in the named scenes, in their order; all if none is named."""
    names = named_scenes(text, folder)
    chosen = named_paths(list(dict.fromkeys(sample.scene for sample in samples)), names)
    return [one for one in samples if not names or one.scene in chosen]


def failed_before(dataset: Path, samples: Sequence[Sample], config: PlaceConfig) -> list[Sample]:
    """Samples that failed or did not finish in the last run; and, for the table of the new run, finished ones whose
    stages are all still cached."""
    folder, asked = last_run(dataset, {sample.method for sample in samples})
    known = [sample for sample in samples if sample.id in asked]
    results = {one.id: read_result(sample_folder(folder, one.id)) for one in known}
    left = {name: error for name, (tree, error) in results.items() if tree is None}
    if not left:
        raise InputError(f"nothing failed in {folder.name}; run without --only-failed")
    done = [one for one in known if one.id not in left]
    cached = {one.id for one in done if plan_sample(one, config, bring=False).finished is not None}
    print_lines(taken_lines(folder.name, left, len(cached), len(done) - len(cached)))
    return [one for one in known if one.id in left or one.id in cached]


def last_run(dataset: Path, methods: set[str]) -> tuple[Path, set[str]]:
    """The newest run of a dataset by these methods, and the ids of its samples."""
    found = []
    for path in runs_root().glob(f"*/{RUN}"):
        tree: dict[str, Any] = {}
        with suppress(InputError, OSError):  # damaged, or of another version
            tree = read_request(path)
        same = tree.get("dataset") == str(dataset.resolve()) and set(tree.get("methods", ())) == methods
        if same and not path.parent.is_symlink():
            found.append((str(tree.get("started")), path.stat().st_mtime_ns, path.parent, tree))
    if not found:
        raise InputError(
            f"--only-failed: no run of {dataset} by {', '.join(sorted(methods))} in {runs_root()}; run without it"
        )
    _, _, folder, tree = max(found, key=lambda one: one[:2])
    return folder, {str(one.get("id")) for one in tree.get("samples", ())}


def taken_lines(run: str, left: Mapping[str, str], cached: int, changed: int) -> list[str]:
    """Lines that say which samples are taken, and which are not and why. `left` are the samples without a result, with
    their errors."""
    broken = [name for name, error in left.items() if error != UNFINISHED]
    unfinished = [name for name, error in left.items() if error == UNFINISHED]
    groups = (("failed", broken), (UNFINISHED, unfinished))
    told = [f"{len(some)} {word} ({first_of(some, SHOWN)})" for word, some in groups if some]
    lines = [f"of {run}: {' and '.join(told)} and run again, {cached} finished and come from the cache"]
    if changed:
        others = "finished with other code or settings; without --only-failed they run, too"
        lines.append(f"left out: {changed} that {others}")
    return lines


def shares_of(text: str) -> dict[str, float]:
    """Shares by name from `train=0.8,val=0.1,test=0.1`; InputError for invalid shares, or a sum other than 1."""
    shares: dict[str, float] = {}
    for word in text.split(","):
        name, _, value = (part.strip() for part in word.partition("="))
        try:
            share = float(value)
        except ValueError:
            share = -1.0
        if not NAME.fullmatch(name) or name in shares or not isfinite(share) or not 0.0 < share <= 1.0:
            raise InputError(
                f"--splits {text!r}: {word.strip()!r} is not a new name with a share; "
                "for example train=0.8,val=0.1,test=0.1"
            )
        shares[name] = share
    if abs(sum(shares.values()) - 1.0) > ROUNDING:
        raise InputError(f"--splits {text!r}: the shares add up to {sum(shares.values()):g}, expected 1")
    return shares


def split_scenes(scenes: Sequence[str], shares: Mapping[str, float], seed: int) -> dict[str, tuple[str, ...]]:
    """The scenes of each split, sorted; sizes by largest remainders. InputError if a split would be empty."""
    order = sorted(scenes, key=lambda one: (chance(seed, "split", one), one))
    exact = {name: share * len(order) for name, share in shares.items()}
    sizes = {name: int(size + ROUNDING) for name, size in exact.items()}
    for name in sorted(exact, key=lambda one: sizes[one] - exact[one])[: len(order) - sum(sizes.values())]:
        sizes[name] += 1
    empty = next((name for name, size in sizes.items() if size == 0), "")
    if empty:
        raise InputError(f"--splits: {empty} would have none of {len(order)} scenes; give it a larger share")
    found, begin = {}, 0
    for name, size in sizes.items():
        found[name] = tuple(sorted(order[begin : begin + size]))
        begin += size
    return found


def spread_samples(
    samples: Sequence[Sample], truths: Sequence[ExpectedOutcome | None], limit: int | None
) -> list[Sample]:
    """At most `limit` samples, in their order; all if it is None.

    Infeasible samples keep their share, at least one if there is any and the limit allows two. Within either group, the
    next sample is one whose scene, object and support were chosen least often; ties go to the sample farthest in the
    list from all chosen ones.
    """
    if limit is None or limit >= len(samples):
        return list(samples)
    refused = [at for at, truth in enumerate(truths) if truth is not None and not truth.feasible]
    others = [at for at in range(len(samples)) if at not in set(refused)]
    quota = min(max(round(limit * len(refused) / len(samples)), 1), len(refused)) if limit > 1 or not others else 0
    chosen: list[int] = []
    seen: Counter[tuple[str, str]] = Counter()

    def often(at: int) -> int:
        return sum(seen[one] for one in traits_of(samples[at], truths[at]))

    for group, count in ((others, limit - quota), (refused, quota)):
        left = list(group)
        for _ in range(min(count, len(left))):
            best = min(left, key=lambda at: (often(at), -min((abs(at - one) for one in chosen), default=0)))
            seen.update(traits_of(samples[best], truths[best]))
            left.remove(best)
            chosen.append(best)
    return [samples[at] for at in sorted(chosen)]


def traits_of(sample: Sample, truth: ExpectedOutcome | None) -> tuple[tuple[str, str], ...]:
    """Traits that distinguish samples."""
    return ("scene", sample.scene), ("object", sample.object), ("support", truth.base if truth else "")
