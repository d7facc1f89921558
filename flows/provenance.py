"""Where a result comes from: every stage behind it, back to the files and the sentence that a person gave.

In: the digest of an artifact, a path in the store, or a file of a sample. Out: a `Lineage`, a graph whose nodes are
artifacts. Nodes that are missing or damaged are marked as such; the others are complete.
"""

import json
import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from dcap.evaluation.run_folder import sample_folder
from dcap.language.model.ledger import ReplyLine, read_lines
from dcap.language.model.reply_folder import ReplyFolder
from dcap.scene.errors import InputError
from dcap.scene.settings import data_root, replies_root, runs_root
from dcap.scene.written_files import digest_of_file
from flows.configure import LEDGER
from flows.find_run import RUN, read_keys, read_request
from flows.output import RECORDS
from flows.place import SECTIONS, PlaceConfig
from flows.run_files import PLACEMENT
from tasks.artifact import FILES, Record, Ref, Source, Store, files_in
from tasks.cache import deciding
from tasks.code import changed_sources, files_behind
from tasks.records import every_record
from tasks.upkeep import ABSENT, flattened

DIGEST = re.compile("[0-9a-f]{6,64}")
"""Digest of an artifact, or its beginning."""
SHOWN = 5
"""Most artifacts that a message names."""


@dataclass(frozen=True, slots=True)
class SourceFile:
    """An input file from a user."""

    name: str
    sha256: str
    size: int
    """[bytes]."""


@dataclass(frozen=True, slots=True)
class ProvenanceStep:
    """One artifact and its maker."""

    sha256: str
    kind: str
    state: str
    """sound, missing or damaged."""
    size: int
    """[bytes]; 0 if it is missing."""
    stage: str | None
    """None for an input file or without a record."""
    record: str | None
    seconds: float | None
    """Wall time of the stage when it was computed [s]."""
    inputs: Mapping[str, str]
    """Artifacts by the names of the stage's inputs."""
    values: Mapping[str, object]
    """Inputs other than artifacts: the sentence, seed, mass, options."""
    config: object
    changed_settings: Mapping[str, object]
    """Settings, by dotted keys, that are not today's defaults."""
    code_files: int
    code_digest: str | None
    """SHA-256 over the digests of all source files that produced it."""
    code_changed: tuple[str, ...]
    """Source files that are different now, or gone."""
    libraries: Mapping[str, str]
    files: tuple[SourceFile, ...]
    """Input files."""


@dataclass(frozen=True, slots=True)
class ModelAnswer:
    """A question that a model answered."""

    question: str
    model: str
    how: str
    """asked, batch or kept."""
    digest: str
    """SHA-256 of the rendered prompt with its pictures; empty where the ledger does not say."""
    reply: str | None
    """SHA-256 of the file with the reply; None if it was not kept."""


@dataclass(frozen=True, slots=True)
class Lineage:
    """Everything from which a result was made."""

    artifact: str
    """The requested artifact."""
    sample: Mapping[str, object] | None
    """Request of the sample, if the artifact is a file of one."""
    roots: tuple[str, ...]
    """Artifacts that are inputs of no other step."""
    steps: Mapping[str, ProvenanceStep]
    """Steps by digest, each after the steps that use it."""
    asked: tuple[ModelAnswer, ...]


def provenance_of(artifact: str) -> Lineage:
    """Lineage of a digest, a path in the store, or a file of a sample."""
    path = resolve_path(artifact)
    if path is None:
        return trace(artifact, [ref_of_digest(artifact)], {})
    ref = ref_of_path(path)
    if ref is not None:
        return trace(artifact, [ref], {})
    folder = next((one for one in (path, *path.parents) if (one / RECORDS).is_file()), None)
    if folder is None:
        raise InputError(
            f"{artifact}: neither in the store nor next to a {RECORDS}; give a file of a sample, or a digest (runs "
            f"of an earlier version have no {RECORDS}: run them again; cached stages are only looked up)"
        )
    return lineage_of_sample(artifact, folder)


def resolve_path(artifact: str) -> Path | None:
    """Resolve a path against the working directory, the runs or the data folder."""
    places = (Path(artifact), runs_root() / artifact, data_root() / artifact)
    return next((path.resolve() for path in places if exists(path)), None)


def exists(path: Path) -> bool:
    """Whether a path exists; False for a name that no file can have."""
    try:
        return path.exists()
    except (OSError, ValueError):
        return False


def ref_of_path(path: Path) -> Ref[Any] | None:
    """The artifact that a path of the store belongs to."""
    root = (Store.default().root / "objects").resolve()
    parts = path.relative_to(root).parts if path.is_relative_to(root) else ()
    return Ref(parts[0], parts[2]) if len(parts) > 2 else None


def ref_of_digest(digest: str) -> Ref[Any]:
    """The artifact whose digest begins with `digest`."""
    if not DIGEST.fullmatch(digest):
        raise InputError(f"{digest!r} is neither a file nor an artifact's digest (6 to 64 hexadecimal digits)")
    known = {*Store.default().refs(), *(ref for _, ref in every_record() if ref is not None)}
    fitting = sorted(ref for ref in known if ref.sha256.startswith(digest))
    if not fitting:
        raise InputError(f"no artifact's digest begins with {digest}; `dcap cache ls` tells where the cache is")
    if len({ref.sha256 for ref in fitting}) > 1:
        told = ", ".join(f"{ref.kind} {ref.sha256[:16]}" for ref in fitting[:SHOWN])
        raise InputError(f"{len(fitting)} artifacts' digests begin with {digest}: {told}; give more digits")
    return fitting[0]


def lineage_of_sample(artifact: str, folder: Path) -> Lineage:
    """Lineage of the files in a sample's folder."""
    rows = read_keys(folder / RECORDS).get("records")
    try:
        refs = [(Ref.from_json(row), str(row["key"])) for row in rows or ()]
    except (KeyError, TypeError) as error:
        raise InputError(f"{folder / RECORDS}: is damaged ({type(error).__name__}); run the sample again") from None
    named = dict(refs)
    run = next((one for one in folder.parents if (one / RUN).is_file()), None)
    sample = sample_request(folder, run)
    asked = model_answers((run or folder) / LEDGER, str(sample.get("id", "")) if sample and run else "")
    found = trace(artifact, list(named), named)
    taken = {digest for one in found.steps.values() for digest in one.inputs.values()}
    roots = tuple(digest for digest in found.roots if digest not in taken)
    return Lineage(artifact, sample, roots, found.steps, asked)


def sample_request(folder: Path, run: Path | None) -> Mapping[str, Any] | None:
    """Request of the sample in a folder."""
    if (folder / PLACEMENT).is_file():
        return dict(read_request(folder / PLACEMENT).get("sample") or {})
    rows = read_request(run / RUN).get("samples") if run else None
    mine = (dict(row) for row in rows or () if run and sample_folder(run, str(row.get("id"))) == folder)
    return next(mine, None)


def model_answers(ledger: Path, sample: str) -> tuple[ModelAnswer, ...]:
    """A model's answers to the questions of a sample, from the run's ledger; of all samples if `sample` is empty."""
    replies = ReplyFolder(replies_root())
    found = {}
    for line in read_lines(ledger):
        if isinstance(line, ReplyLine) and sample in ("", line.sample):
            kept = next(iter(sorted(replies.root.glob(f"*/{line.digest[:2]}/{line.digest}.json"))), None)
            reply = digest_of_file(kept) if line.digest and kept else None
            found[line.question, line.digest] = ModelAnswer(line.question, line.model, line.how, line.digest, reply)
    return tuple(found.values())


def trace(artifact: str, refs: Sequence[Ref[Any]], named: Mapping[Ref[Any], str]) -> Lineage:
    """All artifacts behind `refs`; `named` are the known records of some of them."""
    steps: dict[str, ProvenanceStep] = {}
    waiting = list(refs)
    while waiting:
        ref = waiting.pop()
        if ref.sha256 not in steps:
            step, before = step_of(ref, named.get(ref))
            steps[ref.sha256] = step
            waiting += before
    return Lineage(artifact, None, tuple(dict.fromkeys(ref.sha256 for ref in refs)), steps, ())


def step_of(ref: Ref[Any], key: str | None) -> tuple[ProvenanceStep, list[Ref[Any]]]:
    """An artifact with its maker, and the artifacts that it was made from."""
    record = maker_of(ref, key)
    made = record.recipe if record else {"inputs": {}}
    before = {name: Ref.from_json(one["ref"]) for name, one in made["inputs"].items() if "ref" in one}
    code = files_behind(made["code"]) or {} if record else {}
    state, size = condition(ref)
    step = ProvenanceStep(
        sha256=ref.sha256,
        kind=ref.kind,
        state=state,
        size=size,
        stage=str(made["stage"]) if record else None,
        record=record.key if record else None,
        seconds=record.seconds if record else None,
        inputs={name: one.sha256 for name, one in before.items()},
        values={name: one.get("value") for name, one in made["inputs"].items() if name not in before},
        config=made.get("config"),
        changed_settings=changed_settings(str(made.get("stage")), made.get("config")),
        code_files=len(code),
        code_digest=made.get("code"),
        code_changed=tuple(changed_sources(code)),
        libraries=made.get("libraries", {}),
        files=tuple(given_files(ref)) if ref.kind == Source.__name__ and state == "sound" else (),
    )
    return step, list(before.values())


def maker_of(ref: Ref[Any], key: str | None) -> Record | None:
    """Return the record that made an artifact: the named one, else the newest."""
    known = [(path.stat().st_mtime_ns, one.record) for path, one in every_record() if one == ref and one and one.record]
    named = next((record for _, record in known if record.key == key), None)
    return named or max(known, key=lambda one: one[0], default=(0, None))[1]


def condition(ref: Ref[Any]) -> tuple[str, int]:
    """Whether an artifact is sound, and its size [bytes]."""
    store = Store.default()
    if store.has(ref):
        return "sound", store.size(ref)
    return ("damaged", store.size(ref)) if store.folder(ref).is_dir() else ("missing", 0)


def changed_settings(stage: str, config: object) -> dict[str, object]:
    """Settings of a stage that are not today's defaults."""
    section = getattr(PlaceConfig(), SECTIONS.get(stage, stage), None)
    if section is None or not isinstance(config, Mapping):
        return {}
    usual = dict(flattened(deciding(section.model_dump(mode="json"))))
    return {key: value for key, value in flattened(config) if usual.get(key, ABSENT) != value}


def given_files(ref: Ref[Any]) -> Iterator[SourceFile]:
    """Files of a source artifact."""
    folder = Store.default().folder(ref) / FILES
    for path in files_in(folder):
        yield SourceFile(path.relative_to(folder).as_posix(), digest_of_file(path), path.stat().st_size)


def provenance_lines(found: Lineage) -> list[str]:
    """The graph as a tree of lines; each artifact is expanded once."""
    lines = [found.artifact]
    if found.sample:
        lines += [f"sample {found.sample.get('id')}: {json.dumps(found.sample.get('prompt'), ensure_ascii=False)}"]
    lines += [f"asked {one.model}: {one.question} ({one.how}), prompt {one.digest[:12] or 'unknown'}, reply "
              f"{(one.reply or 'not kept')[:12]}" for one in found.asked]  # fmt: skip
    told: set[str] = set()
    for root in found.roots:
        lines += tree_lines(found.steps, root, "", "", told)
    return lines


def tree_lines(
    steps: Mapping[str, ProvenanceStep], digest: str, name: str, indent: str, told: set[str]
) -> Iterator[str]:
    """Lines for an artifact and its inputs."""
    one = steps[digest]
    label = f"{indent}{name + ': ' if name else ''}{one.kind} {digest[:12]}"
    if digest in told:
        yield f"{label} (see above)"
        return
    told.add(digest)
    yield f"{label}{'' if one.state == 'sound' else f' {one.state.upper()}'}{maker_words(one)}"
    inner = f"{indent}  "
    yield from (f"{inner}| {line}" for line in details(one))
    for word, before in one.inputs.items():
        yield from tree_lines(steps, before, word, inner, told)


def maker_words(one: ProvenanceStep) -> str:
    """Maker of an artifact, in a few words."""
    if one.stage is None:
        return "" if one.kind == Source.__name__ else ", no record tells what made it"
    return f" by {one.stage}, {one.seconds:.2f} s"


def details(one: ProvenanceStep) -> Iterator[str]:
    """Values, settings, code and files in lines."""
    values = {name: value for name, value in one.values.items() if value is not None}
    if values:
        yield ", ".join(f"{name} {json.dumps(value, ensure_ascii=False)}" for name, value in values.items())
    if one.changed_settings:
        yield "settings " + ", ".join(f"{key} {json.dumps(value)}" for key, value in one.changed_settings.items())
    if one.code_files:
        now = f"{len(one.code_changed)} different now" if one.code_changed else "none different now"
        yield f"code {str(one.code_digest)[:12]}, {one.code_files} files, {now}"
    if one.libraries:
        yield ", ".join(f"{name} {version}" for name, version in one.libraries.items())
    yield from (f"{file.name} {file.sha256} ({file.size} bytes)" for file in one.files)
