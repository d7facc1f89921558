"""Request of a run or of one placement, as stored in its folder: samples and configuration.

A run has `run.json`; a folder that `place --out` wrote has `sample.json`, and is named like a run with one sample.
"""

from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path

from pydantic import TypeAdapter

from dcap.evaluation.run_folder import sample_folder
from dcap.language.protocol.client import LanguageConfig
from dcap.scene.errors import InputError
from dcap.scene.settings import runs_root
from dcap.scene.types.sample import Sample
from dcap.scene.written_files import JsonObject, write_whole
from flows.configure import LanguageOptions
from flows.find_run import ASKED_VERSION, RUN, find_run, input_errors, read_keys, read_request
from flows.output import load_values, readable_json
from flows.place import PlaceConfig
from flows.placement_json import Values
from flows.sample_run import FinishedSample, plan_sample
from tasks.artifact import Store

PLACEMENT = "sample.json"
SAMPLE = TypeAdapter(Sample)
UNFINISHED = "did not finish"
"""Message for a sample whose placement did not finish."""


@dataclass(frozen=True, slots=True)
class RunRequest:
    """Request of a run, or of one placement."""

    folder: Path
    samples: Mapping[str, Sample]
    config: PlaceConfig
    language: LanguageOptions
    one: bool = False
    """Whether the folder is that of one placement."""

    def sample(self, name: str) -> Sample:
        """A sample by its id."""
        if name not in self.samples:
            raise InputError(
                f"{name!r} is not a sample of {self.folder.name}; it has {', '.join(sorted(self.samples))}"
            )
        return self.samples[name]

    def folder_of(self, name: str) -> Path:
        """Folder with the files of a sample."""
        return self.folder if self.one else sample_folder(self.folder, name)


@dataclass(frozen=True, eq=False, slots=True)
class FinishedPlacement:
    """One placement with the values of its stages."""

    folder: Path
    """Folder with its files."""
    finished: FinishedSample
    values: Values
    config: PlaceConfig


def load_run_request(folder: Path) -> RunRequest:
    """Read the request of the run in a folder."""
    return request_in(folder / RUN, one=False)


def request_in(path: Path, *, one: bool) -> RunRequest:
    """Read the request in a `run.json`, or in the `sample.json` of one placement."""
    tree = read_request(path)
    with input_errors(path):
        samples = [sample_from_json(row) for row in ([tree["sample"]] if one else tree["samples"])]
        config, language = PlaceConfig.model_validate(tree["config"]), LanguageOptions(**tree["language"])
    return RunRequest(path.parent.resolve(), {sample.id: sample for sample in samples}, config, language, one=one)


def read_result(folder: Path) -> tuple[JsonObject | None, str]:
    """placement.json or the error of a sample's folder."""
    failure = folder / "error.txt"
    if failure.is_file():
        said = failure.read_text(encoding="utf-8", errors="replace")
        return None, next(iter(said.splitlines()), "failed without a message")
    if not (folder / "placement.json").is_file():
        return None, UNFINISHED
    try:
        return read_keys(folder / "placement.json"), ""
    except InputError as damaged:
        return None, str(damaged)


def chooser_of(folder: Path) -> LanguageConfig:
    """Name of the client that answered the questions of the run in a folder."""
    tree = read_request(folder / RUN)
    with input_errors(folder / RUN):
        known = tree.get("config", {}).get("intent", {}).get("language", {})
        return LanguageConfig.model_validate(known)


def find_request(run: str, sample: str | None) -> tuple[RunRequest, str]:
    """Find the request and the sample's id for a sample of a run, or for the folder of a placement without a sample."""
    for folder in (Path(run), runs_root() / run):
        if (folder / PLACEMENT).is_file() and not (folder / RUN).is_file():
            asked = request_in(folder / PLACEMENT, one=True)
            (name,) = asked.samples
            if sample not in (None, name):
                raise InputError(f"{run} is one placement: leave {sample!r} out")
            return asked, name
    asked = load_run_request(find_run(run))
    if not asked.samples:
        raise InputError(f"{asked.folder.name} has no samples")
    if sample is None:
        raise InputError(
            f"{asked.folder.name} is a run: name a sample of it; it has {', '.join(sorted(asked.samples))}"
        )
    asked.sample(sample)
    return asked, sample


def finished_placement(run: str, sample: str | None) -> FinishedPlacement:
    """Results of a sample's stages from the store, without later measurements; InputError if one is no longer there."""
    asked, name = find_request(run, sample)
    finished = finished_sample(asked, name)
    return FinishedPlacement(asked.folder_of(name), finished, load_values(finished, Store.default()), asked.config)


def finished_sample(asked: RunRequest, name: str) -> FinishedSample:
    """Results of the stages of a sample; InputError if one is no longer in the store."""
    plan = plan_sample(asked.sample(name), asked.config.model_copy(update={"measured": False}))
    if plan.finished is None:
        why = plan.failed.message if plan.failed else f"stage {plan.missing[0].stage} is not cached ({plan.why})"
        again = "place it again" if asked.one else "run the benchmark again"
        raise InputError(f"{name} of {asked.folder.name}: {why}; {again}")
    return plan.finished


def write_request(folder: Path, sample: Sample, config: PlaceConfig, language: LanguageOptions) -> None:
    """Write the request of a placement into the folder with its files."""
    tree = {
        "version": ASKED_VERSION,
        "sample": asdict(located(sample)),
        "config": config.model_dump(mode="json"),
        "language": asdict(language.located()),
    }
    write_whole(folder / PLACEMENT, readable_json(tree))


def located(sample: Sample) -> Sample:
    """The sample with absolute paths, so that a run can be repeated from any working directory. Links are not resolved:
    the name of a label file decides how it is read."""

    def whole(path: str) -> str:
        return str(Path(path).absolute()) if path and Path(path).exists() else path

    return replace(
        sample, scene=whole(sample.scene), object=whole(sample.object), labels=whole(sample.labels),
        examples=tuple(whole(one) for one in sample.examples),
    )  # fmt: skip


def sample_from_json(tree: Mapping[str, object]) -> Sample:
    """The sample that `asdict` wrote; ValueError for another tree."""
    return SAMPLE.validate_python(tree)
